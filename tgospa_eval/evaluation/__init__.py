"""The pipeline from two sides to a proven number; data and solvers meet only here."""
