"""Requests of people and of the command line, and their results."""
