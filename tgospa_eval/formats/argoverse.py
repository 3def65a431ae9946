"""Argoverse 2: annotations in a Feather file, by the names of its columns; needs pyarrow."""

from dataclasses import replace

from tgospa_eval.formats.columns.asked import parse_columns
from tgospa_eval.formats.feather import read_feather
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.rows import Rows

ARGOVERSE_HEADERS = {
    "id": "track_uuid",
    "t": "timestamp_ns",
    "class": "category",
    "x": "tx_m",
    "y": "ty_m",
    "z": "tz_m",
}


def read_argoverse(path: str, data: bytes, options: ReadOptions, role: str, *, given: bool) -> Rows:
    """The rows of a Feather file, states by default the centres (x, y), the same in either role.

    Raises
    ------
    InputError
        As of any Feather file. Rows count from 0.
    ConfigError
        pyarrow is not installed.
    """
    if not options.boxes:
        mapped, wanted = parse_columns(options.columns)
        wanted = wanted or ("x", "y")
        names = dict.fromkeys(("id", "t", "class", *mapped, *wanted))  # states in their order
        headers = {name: mapped.get(name) or ARGOVERSE_HEADERS.get(name) for name in names}
        items = tuple(f"{name}={header}" if header else name for name, header in headers.items())
        options = replace(options, columns=items)
    return read_feather(path, data, options, role, given=given)
