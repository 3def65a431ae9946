"""Work with many evaluations: batches and stores, rankings, comparisons of solvers, gates."""

SCHEMA = "tgospa-eval/compare/1"
