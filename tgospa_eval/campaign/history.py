"""Values of a gate over time: a file of JSON lines that grows by one line a run.

Two branches that both add lines merge by union; lines are put in order of time where they are read.
"""

import json
import os
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from tgospa_eval.campaign.gate_report import title
from tgospa_eval.campaign.outcome import PairOutcome
from tgospa_eval.common.documents import MOMENT, NUMBER, TEXT, Maybe, checked
from tgospa_eval.common.files import is_missing, named, read_bytes
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import number
from tgospa_eval.errors import ConfigError
from tgospa_eval.reports.rendering import Table, text_lines
from tgospa_eval.results.records import Json
from tgospa_eval.text import visible

SCHEMA = "tgospa-eval/history/1"

COMMITS = ("GITHUB_SHA", "CI_COMMIT_SHA", "GIT_COMMIT")
"""Variables of CI systems that have the commit."""

POINT = {
    "time": MOMENT,
    "commit": TEXT,
    "values": {...: {"values": {...: NUMBER}, "judged": TEXT, "verdict": Maybe(TEXT)}},
}
"""Description of a line."""

OPTION = "--history"
MOST_BYTES = 1 << 28


@dataclass(frozen=True, kw_only=True)
class HistoryPoint:
    """One run of a gate.

    Parameters
    ----------
    time : str
        ISO 8601, of UTC.
    commit : str
        Blank where it is not known.
    values : mapping
        By name of pair or group: ``values`` by path, and ``judged``, a digest of what must be the
        same for numbers to be comparable.
    """

    time: str
    commit: str
    values: Mapping[str, Mapping[str, Any]]


def commit_now() -> str:
    """The commit of the working tree; blank outside of git."""
    for name in COMMITS:
        if os.environ.get(name):
            return os.environ[name]
    try:
        command = ("git", "rev-parse", "--verify", "--quiet", "HEAD")
        found = subprocess.run(command, capture_output=True, check=False, text=True)
    except FileNotFoundError:
        return ""
    return found.stdout.strip() if found.returncode == 0 else ""


def load_history(path: str) -> list[HistoryPoint]:
    """The runs of a history in order of time; none without a file.

    Raises
    ------
    ConfigError
        It cannot be read, or a line is none of a history.
    """
    if is_missing(path):
        return []
    found = []
    lines = read_bytes(path, ConfigError, MOST_BYTES).decode("utf-8", "replace").splitlines()
    for at, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            record = checked(line, POINT)
        except ValueError as error:
            mark = " (a merge conflict)" if line.startswith(("<<<<", "====", ">>>>")) else ""
            raise ConfigError(
                f"{path}, line {at}: is no line of a history{mark}: {error}; mend or remove it"
            ) from None
        point = HistoryPoint(
            time=datetime.fromisoformat(record["time"]).astimezone(UTC).isoformat(),
            commit=record["commit"],
            values=record["values"],
        )
        found.append(point)
    return sorted(found, key=lambda point: point.time)


def append_history(path: str, outcomes: Iterable[PairOutcome]) -> None:
    """Add a line with the values of pairs and groups; of an update there are none.

    Raises
    ------
    ConfigError
        The file cannot be written.
    """
    values = {
        title(one): {
            "values": {name: value.upper for name, value in one.values.items()},
            "judged": one.judged,
            "verdict": one.verdict,
        }
        for one in outcomes
        if one.values
    }
    if not values:
        return
    record = {
        "schema": SCHEMA,
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit_now(),
        "values": values,
    }
    line = json.dumps(record, sort_keys=True, allow_nan=False)
    with named(f"{OPTION} {path}", ConfigError, "cannot be written"):
        whole = is_missing(path) or os.path.getsize(path) == 0 or _ends_with_newline(path)
        with open(path, "a", encoding="utf-8", newline="\n") as file:
            file.write(f"{'' if whole else chr(10)}{line}\n")


def _ends_with_newline(path: str) -> bool:
    with open(path, "rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1) == b"\n"


def best_of_last(
    history: Iterable[HistoryPoint], name: str, judged: str, path: str, count: int
) -> float | None:
    """The least value of the last runs that were judged alike; None without any."""
    alike = [
        one["values"][path]
        for point in history
        if (one := point.values.get(name)) and one["judged"] == judged and path in one["values"]
    ]
    return min(alike[-count:], default=None)


def history_document(points: Sequence[HistoryPoint]) -> Json:
    """All runs, in order of time."""
    return {"schema": SCHEMA, "runs": [vars(point) for point in points]}


BARS = " .:-=+*#"
"""Heights of a line in the terminal, the smallest first."""

DRAWN = 40
"""Runs of a line in the terminal: the last ones."""


def history_table(points: Sequence[HistoryPoint], path: str, unicode: bool) -> str:
    """The values of one path over time, a line for each pair and group.

    Parameters
    ----------
    points : sequence of HistoryPoint
        In order of time.
    path : str
        Such as ``total``.
    unicode : bool
        Whether bars can be drawn.
    """
    rows = [
        (visible(name), str(len(values)), *(number(v, 6) for v in ends), _line(values, unicode))
        for name, values in series(points, path).items()
        if (ends := (values[0], min(values), values[-1]))
    ]
    if not rows:
        return f"no run of this history has {path}\n"
    first, last = points[0], points[-1]
    about = [f"{point.time[:16]} {point.commit[:12]}".rstrip() for point in (first, last)]
    head = (path, "runs", "first", "best", "last", f"last {DRAWN} runs, upward is worse")
    table = Table(head=head, rows=rows, align="lrrrrl")
    return "\n".join([f"{about[0]} to {about[1]}", "", *text_lines(table, "")]) + "\n"


def series(points: Sequence[HistoryPoint], path: str) -> dict[str, list[float]]:
    """Values over time by name; judged otherwise than the last run they are left out."""
    found: dict[str, list[float]] = {}
    last = {name: one["judged"] for point in points for name, one in point.values.items()}
    for point in points:
        for name, one in point.values.items():
            if path in one["values"] and one["judged"] == last[name]:
                found.setdefault(name, []).append(one["values"][path])
    return found


def _line(values: Sequence[float], unicode: bool) -> str:
    """Bars of the last values, from the least of them to the largest."""
    shown = values[-DRAWN:]
    bars = "▁▂▃▄▅▆▇█" if unicode else BARS
    low, high = min(shown), max(shown)
    if low == high:
        return bars[0 if unicode else 1] * len(shown)
    return "".join(bars[int((value - low) / (high - low) * (len(bars) - 1))] for value in shown)
