"""Numbers of a run against those of a baseline: rules, verdicts, baseline files, suites.

Knows no command line, reads no trajectories and solves nothing.
"""
