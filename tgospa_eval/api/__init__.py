"""Evaluations, batches, rankings and gates, as Python and the command line request them."""
