"""The verbs `associate` and `reduce`."""
