"""States of two sensors: which belong together, and clouds of fewer particles."""
