"""Pipeline from truth and estimate to a proven number; data and solvers meet only here."""
