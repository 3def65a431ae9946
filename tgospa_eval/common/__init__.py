"""Helpers for the whole package: messages, files, progress, numbers as text."""
