"""Proof folders: a number with what a third party needs to check it again."""

PROOF_FOLDER = "proof"
"""Folder of the proof in a result folder."""
