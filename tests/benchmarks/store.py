"""Measurements as JSON lines: whatever is there is not measured again."""

import json
from typing import Any

from machine import HERE, commit, fingerprint

PATH = HERE / "results" / "results.jsonl"

Values = dict[str, Any]


class Store:
    """The measurements of this machine, these versions and these sources.

    Parameters
    ----------
    fresh : bool
        Start anew: forget all measurements.
    """

    def __init__(self, *, fresh: bool = False) -> None:
        self._stamp = {"fingerprint": fingerprint(), "commit": commit()}
        self._found: dict[tuple[str, ...], Values] = {}
        if fresh:
            PATH.unlink(missing_ok=True)
        if PATH.exists():
            for line in PATH.read_text(encoding="utf-8").splitlines():
                record = json.loads(line)
                if record["fingerprint"] == self._stamp["fingerprint"]:
                    self._found[tuple(record["key"])] = record["values"]

    def get(self, *key: str) -> Values | None:
        """What was measured under the key: part, setting, seed, method."""
        return self._found.get(key)

    def add(self, *key: str, values: Values) -> None:
        """Keep a measurement, on disk at once."""
        self._found[key] = values
        PATH.parent.mkdir(exist_ok=True)
        with PATH.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"key": key, "values": values, **self._stamp}) + "\n")
