"""Several evaluations together: solvers, estimates, sizes. Has no options and no pages."""

SCHEMA = "tgospa-eval/compare/1"
