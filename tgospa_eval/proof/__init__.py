"""Proof folders: a number with what a third party needs to check it again."""

PROOF_FOLDER = "proof"
"""Where a result folder has its proof."""
