"""Rows judged by a baseline: rules, suites, groups of seeds, reports."""
