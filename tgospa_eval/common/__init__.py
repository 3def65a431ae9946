"""Helpers of every room: messages, files, progress, numbers as text."""
