"""Evaluation of data larger than memory: blocks of time, then components, then sums."""
