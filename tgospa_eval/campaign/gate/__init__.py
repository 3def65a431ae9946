"""Gate: judgement of new results by rules and a baseline, with suites, groups and reports."""
