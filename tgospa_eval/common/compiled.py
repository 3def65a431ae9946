"""Extension modules where they were built; everything works without them, more slowly."""

import os
from importlib import import_module
from typing import Any


def compiled(name: str) -> Any:
    """An extension module, or None. ``TGOSPA_EVAL_KERNEL=numpy`` leaves all aside."""
    if os.environ.get("TGOSPA_EVAL_KERNEL") == "numpy":
        return None
    try:
        return import_module(name)
    except ImportError:
        return None
