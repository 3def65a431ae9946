"""Formats of files by name, of this package and of other packages.

This module imports nothing that is slow to import. docs/architecture.md says how to add a format to
this package. docs/reference/extend.md says how another package adds a format.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from tgospa_eval.common.registry import Registry

if TYPE_CHECKING:
    import pandas as pd

    from tgospa_eval.formats.rows import Rows

    Reader = Callable[..., Rows | pd.DataFrame]


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
"""Readers by the name of the format: functions that read rows from the bytes of a file."""
