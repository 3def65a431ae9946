"""Several evaluations side by side: solvers, estimates, sizes. Knows no options and no pages."""

SCHEMA = "tgospa-eval/compare/1"
