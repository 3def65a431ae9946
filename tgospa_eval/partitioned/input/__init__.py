"""One side in many parts: which there are, their times, their rows in order of time."""
