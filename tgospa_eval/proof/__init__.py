"""Proof folders: a result with the data that a third party needs to check it."""

PROOF_FOLDER = "proof"
"""Name of the proof folder in a result folder."""
