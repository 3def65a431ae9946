"""Proof folders: the bounds of a result, with all data that others need to check them."""

PROOF_FOLDER = "proof"
"""Name of the proof folder in a result folder."""
