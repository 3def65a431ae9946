"""The gate: rows judged by a baseline, with rules, suites, groups of seeds and reports."""
