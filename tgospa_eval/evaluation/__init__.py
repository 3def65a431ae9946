"""The line from two sides to a proven number; the only place where data and solvers meet."""
