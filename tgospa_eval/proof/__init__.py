"""Proof folders: a number with what a third party needs to check it again."""
