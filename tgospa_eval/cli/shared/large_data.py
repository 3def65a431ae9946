"""Options for data that are larger than memory."""

import re
from typing import Any

import click

from tgospa_eval.cli.shared.option import option

BYTES_OF = {"": 10**9, "KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
BYTES_OF |= {"KIB": 2**10, "MIB": 2**20, "GIB": 2**30, "TIB": 2**40}

LEAST_MEMORY = 100 * 10**6
"""Bytes with which a process can work at all."""


class Size(click.ParamType):  # type: ignore[type-arg]  # generic since click 8.4
    """Bytes as people write them: 4GB, 500MB, 1.5GiB; a number alone is of GB."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """The bytes."""
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            self.fail(f"{value!r} is no size; write 4GB or 500MB", param, ctx)
        found = re.fullmatch(r"\s*([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*([A-Za-z]*)\s*", str(value))
        unit = BYTES_OF.get(found[2].upper()) if found else None
        if found is None or unit is None:
            self.fail(
                f"{str(value)!r} is no size; write 4GB or 500MB, a number alone is of GB",
                param,
                ctx,
            )
        size = float(found[1]) * unit
        if not LEAST_MEMORY <= size < 2**60:
            self.fail(f"{value} is less than 100MB, or more than there is", param, ctx)
        return int(size)


MEMORY_OPTION = option(
    "--memory SIZE",
    "Memory that the evaluation may take, 4GB or 500MB. Folders of Parquet or CSV files, and files "
    "that would take more, are read and evaluated in parts. With --scheduler that of each worker.",
    section="Files",
    type=Size(),
    show_default="half of the machine's",
)
SCHEDULER_OPTION = option(
    "--scheduler ADDRESS",
    "For data in parts: use the workers of a Dask cluster that is there, tcp://host:8786. Default: "
    "as many processes as --jobs says.",
    section="Solver",
)
IN_PARTS_OPTIONS = (MEMORY_OPTION, SCHEDULER_OPTION)
