"""The metric as a sparse linear programme, and the proof of bounds of its optimum."""
