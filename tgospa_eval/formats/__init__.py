"""FILES and objects -> Trajectories: readers by name, how to read, and what was read.

The public names are imported when they are used: the command line needs the names of formats
alone. How to add one: docs/architecture.md, from outside docs/reference/extend.md.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from tgospa_eval.common.registry import Registry, lazy

if TYPE_CHECKING:  # with `as`, which makes a name public
    import pandas as pd

    from tgospa_eval.formats.objects import read as read
    from tgospa_eval.formats.objects import read_trajectories as read_trajectories
    from tgospa_eval.formats.objects import runs_inside as runs_inside
    from tgospa_eval.formats.options import ROLES as ROLES
    from tgospa_eval.formats.options import ReadOptions as ReadOptions
    from tgospa_eval.formats.reading import Reading as Reading
    from tgospa_eval.formats.rows import Rows

    Reader = Callable[..., Rows | pd.DataFrame]

_HOME = {
    "ROLES": "options",
    "ReadOptions": "options",
    "Reading": "reading",
    "read": "objects",
    "read_trajectories": "objects",
    "runs_inside": "objects",
}

__getattr__ = lazy(__name__, _HOME)

__all__ = ["FORMATS", *_HOME]


def _reader(name: str, value: Any) -> "Reader":  # noqa: ARG001
    if not callable(value):
        raise TypeError(f"it is {type(value).__name__}, not a function")
    reader: Reader = value
    return reader


FORMATS: "Registry[Reader]" = Registry(
    "format",
    "tgospa_eval.formats",
    {
        "csv": "tgospa_eval.formats.text.table:read_table",
        "parquet": "tgospa_eval.formats.arrow:read_parquet",
        "feather": "tgospa_eval.formats.arrow:read_feather",
        "motchallenge": "tgospa_eval.formats.text.table:read_motchallenge",
        "visdrone": "tgospa_eval.formats.text.table:read_visdrone",
        "kitti": "tgospa_eval.formats.text.table:read_kitti",
        "npz": "tgospa_eval.formats.arrays:read_npz",
        "npy": "tgospa_eval.formats.arrays:read_npy",
        "mat": "tgospa_eval.formats.matlab:read_mat",
        "nuscenes": "tgospa_eval.formats.records:read_nuscenes",
        "argoverse": "tgospa_eval.formats.arrow:read_argoverse",
        "json": "tgospa_eval.formats.records:read_json",
        "xlsx": "tgospa_eval.formats.records:read_excel",
        "wide": "tgospa_eval.formats.frames:read_wide",
        "deeplabcut": "tgospa_eval.formats.frames:read_deeplabcut",
        "tum": "tgospa_eval.formats.folders:read_tum",
        "csv-per-object": "tgospa_eval.formats.folders:read_tables",
        "yolo": "tgospa_eval.formats.folders:read_yolo",
    },
    _reader,
)
"""Functions from the bytes of a file to its rows, by the name of the format."""
