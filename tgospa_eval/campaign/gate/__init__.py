"""Gate: verdicts on rows by a baseline, with rules, suites, groups of seeds and reports."""
