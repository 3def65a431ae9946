"""FILES -> Trajectories: readers by name, how to read, and what was read."""

from tgospa_eval.formats.options import ROLES, ReadOptions
from tgospa_eval.formats.reading import Reading
from tgospa_eval.formats.registry import FORMATS, read, read_trajectories, runs_inside

__all__ = [
    "FORMATS",
    "ROLES",
    "ReadOptions",
    "Reading",
    "read",
    "read_trajectories",
    "runs_inside",
]
