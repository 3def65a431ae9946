"""Comparisons of several evaluations (solvers, estimates, sizes), without options and pages."""

SCHEMA = "tgospa-eval/compare/1"
