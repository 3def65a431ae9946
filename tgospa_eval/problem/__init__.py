"""The metric as a sparse linear programme, and what proves a bound of its optimum."""
