"""Rows of stores, tables and gates. A row has the numbers of one result, by column."""

import json
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.common.arrays import Ints
from tgospa_eval.common.documents import (
    ANYTHING,
    COST,
    COUNT,
    FLAG,
    NUMBER,
    TEXT,
    FieldKind,
    checked,
    one_of,
    or_null,
)
from tgospa_eval.common.interval import Interval, equal, overlap
from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted
from tgospa_eval.errors import SolverError
from tgospa_eval.evaluation.pair import EvaluationByClass
from tgospa_eval.quoting import clipped, quoted
from tgospa_eval.results import saved
from tgospa_eval.results.consistency import NEES, STORED_NEES, NeesSums, fits_sums
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.records import COUNTED_PARTS, PARTS, SPLIT_PARTS
from tgospa_eval.results.summary import SUMMARY, flat

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

Row = dict[str, Any]
"""Values by the name of the column. Names of columns with labels begin with ``label.``."""

LABEL = "label."
"""Prefix of the names of columns with labels."""

OFF_STEPS = {role: f"input.{role}.left_out.steps" for role in ("truth", "estimate")}
"""Columns that count rows of truth and estimate outside the declared steps."""

PARAMETER_COLUMNS = ("distance", "cutoff", "order", "switch_penalty")
"""Parameters of the metric that have a column of their own in every row."""

STORED_SLICES = "slices"
"""Column with costs by slice, as JSON text."""


def row_of(result: Evaluation) -> Row:
    """Return the row of a result, without status, messages and version."""
    parameters = result.proof.parameters
    truth, estimates = result.objects
    return {
        **result.proof.numbers(result.gap, result.evaluated_on.each),
        **{f"sizes.{name}": value for name, value in result.sizes.items()},
        **{f"judged.{name}": value for name, value in result.evaluated_on.row().items()},
        "sizes.truth_states": truth,
        "sizes.estimate_states": estimates,
        "cutoff": parameters.cutoff,
        "order": parameters.order,
        "switch_penalty": parameters.switch_penalty,
        "distance": str(result.parameters["distance"]),
        "parameters": json.dumps(result.parameters, sort_keys=True),
        **{f"input.{role}.sha256": side["sha256"] for role, side in result.input.items()},
        **{
            name: result.input[role]["left_out"].get("steps", 0) for role, name in OFF_STEPS.items()
        },
        **result.other_numbers,
        **result.split_parts,
        **({} if result.nees is None else result.nees.row()),
        **{f"with.{name}": value for name, value in result.sums.items()},
        **dict(flat(result.summarised.numbers)),
    }


def row_to_judge(result: Evaluation) -> Row:
    """Return the complete row of a result for a gate or a store.

    If classes are evaluated separately, the field ``classes`` has their rows.
    """
    parts = result.results if isinstance(result, EvaluationByClass) else {}
    return {
        **row_of(result),
        **({"classes": {name: row_of(part) for name, part in parts.items()}} if parts else {}),
        "status": "done" if result.finished else "open",
        "message": str(result.solver["status"]),
        "warnings": json.dumps([notice.record() for notice in result.warnings]),
        "notices": json.dumps(result.notices),
        "version": result.version,
    }


def covariances_of(rows: "pd.DataFrame") -> tuple[dict[str, float], NeesSums | None]:
    """Add up the parts of the localisation cost, and the sums of NEES, over the rows.

    A part is left out if any row lacks it. NEES is None if any row lacks it.
    """
    parts = [name for name in SPLIT_PARTS if name in rows and rows[name].notna().all()]
    each = [NeesSums.of_row({STORED_NEES: text}) for text in rows.get(STORED_NEES, ())]
    nees = NeesSums.joined(filter(None, each)) if all(each) else None
    return {name: float(rows[name].sum()) for name in parts}, nees


def stored_slices(result: Evaluation) -> dict[str, str]:
    """Return the column with costs by slice for the row of a job; empty without slices."""
    if not result.slicings:
        return {}
    return {STORED_SLICES: json.dumps([one.record() for one in result.slicings])}


def labels_of(row: Mapping[Any, Any]) -> dict[str, str]:
    """Return the labels of a job. The job's own options are the value of the label ``options``."""
    labels = {
        str(name).removeprefix(LABEL): str(value)
        for name, value in row.items()
        if str(name).startswith(LABEL)
    }
    own = [f"{key}={value}" for key, value in json.loads(row["options"]).items()]
    return labels | ({"options": " ".join(own)} if own else {})


def job_name(row: Mapping[Any, Any]) -> str:
    """Return the name of a job: the values of its labels, and its own options.

    Without labels, the path of the estimate is used.
    """
    labels = labels_of(row)
    own = labels.pop("options", "")
    return " ".join(filter(None, ("/".join(labels.values()) or str(row["estimate"]), own)))


def job_in_words(row: Mapping[Any, Any]) -> str:
    """Return the name of a job for messages: ``tracker=a run=1``; without labels, its estimate."""
    labels = labels_of(row)
    own = labels.pop("options", "")
    named = " ".join(f"{label}={value}" for label, value in labels.items())
    return " ".join(filter(None, (named or str(row["estimate"]), own)))


# -------------------------------------------------------------------------------------------------
# Checks of stored rows.

TOTALS = ("tgospa", "lower_bound", "upper_bound", "total", "total_lower", "total_upper")
PER_STEP = "normalised.tgospa"

OF_ALL: dict[str, FieldKind] = {
    "key": TEXT,
    "status": one_of("done", "open", "failed"),
    "message": TEXT,
    **dict.fromkeys(("truth", "estimate", "options", "version"), TEXT),
    "seconds": COST,
    "finished": COUNT,
}
"""Columns of every job."""

OF_VALUES: dict[str, FieldKind] = {
    **dict.fromkeys((*TOTALS, PER_STEP, *PARTS), COST),
    "certified": FLAG,
    **{f"counts.{name}": COST for name in COUNTED_PARTS},
    **{f"judged.{name}": kind for name, kind in saved.EVALUATED_ON.items()},
    **dict.fromkeys(("sizes.steps", "sizes.truth_states", "sizes.estimate_states"), COUNT),
    **{name: saved.PARAMETERS[name] for name in PARAMETER_COLUMNS},
    **dict.fromkeys(("parameters", "warnings"), TEXT),
    **{f"input.{role}.sha256": TEXT for role in saved.ROLES},
    **dict.fromkeys(OFF_STEPS.values(), COUNT),
}
"""Columns of all jobs with a value."""

OF_SOME: dict[str, FieldKind] = {
    **dict.fromkeys((*SPLIT_PARTS, NEES), or_null(COST)),
    **dict.fromkeys((STORED_NEES, STORED_SLICES, "not_written", "notices"), or_null(TEXT)),
    "per_step.rows": or_null(COUNT),
    "per_step.curve": or_null(FLAG),
    "iterations": or_null(COUNT),
    "seconds.prepare": or_null(COST),
    **dict.fromkeys(("entropic.dual", "entropic.cost"), or_null(NUMBER)),
}
"""Columns that some jobs have."""

SEVERAL = FieldKind(
    "a finite number, a list of such, or null",
    lambda value: value is None or all(map(NUMBER.fits, value if type(value) is list else [value])),
)
OF_SEVERAL: dict[str, FieldKind] = {
    LABEL: or_null(TEXT),
    "with.": SEVERAL,
    "sizes.": or_null(COUNT),
    f"{SUMMARY}.": or_null(NUMBER),
    "judged.": or_null(TEXT),
    f"{NEES}.": FieldKind(
        "a finite number, a text, or null", lambda value: TEXT.fits(value) or SEVERAL.fits(value)
    ),
}
"""Columns whose names begin with one of these prefixes."""

AS_JSON = {
    "options": {...: TEXT},
    "parameters": saved.PARAMETERS,
    "warnings": [saved.NOTICE],
    "notices": [TEXT],
    STORED_NEES: saved.NEES_SUMS,
    STORED_SLICES: [saved.SLICING],
}
"""Columns whose values are JSON texts, and the expected form of the JSON."""


def column_fault(
    table: "pa.Table", columns: Mapping[str, FieldKind], numbers: Ints | None = None
) -> str | None:
    """Describe the first column that is missing or has a wrong value; None if all columns fit.

    Parameters
    ----------
    table : Table
        Rows of one file of the store, or some of them.
    columns : mapping of str to FieldKind
        Expected kind of value, by column.
    numbers : (N,) int array, optional
        Index of each row in the file, if `table` has only some rows.
    """
    counts = Counter(table.column_names)
    for name, kind in columns.items():
        if counts[name] != 1:
            there = "is a duplicate" if counts[name] else "is missing"
            return f"column {name}: {there}; expected {kind.name}"
        row = _first_wrong(table[name], kind)
        if row is not None:
            value = clipped(json.dumps(table[name][row].as_py(), default=str))
            number = row if numbers is None else int(numbers[row])
            return f"row {number + 1}: {name} is {value}; expected {kind.name}"
    return None


def _first_wrong(column: "pa.ChunkedArray", kind: FieldKind) -> int | None:
    """Return the index of the first value that does not fit; None if all fit."""
    import pyarrow.types as types

    def is_number(kind: "pa.DataType") -> bool:
        return bool(types.is_integer(kind) or types.is_floating(kind))

    few: list[Any] | None = None
    if types.is_string(column.type) or types.is_dictionary(column.type):
        few = column.unique().to_pylist()
    elif len(column) and not column.null_count and is_number(column.type):
        values = column.to_numpy()  # all values fit if both extremes fit
        few = [values.min().item(), values.max().item()]
    if few is not None and all(map(kind.fits, few)):
        return None
    return next((k for k, value in enumerate(column.to_pylist()) if not kind.fits(value)), None)


def known_columns(table: "pa.Table") -> dict[str, FieldKind]:
    """Return the expected kind of value for each known column of a table."""
    begins = tuple(OF_SEVERAL)
    exact: dict[str, FieldKind] = OF_ALL | dict.fromkeys(OF_VALUES, ANYTHING) | OF_SOME
    return {
        name: exact.get(name) or next(OF_SEVERAL[one] for one in begins if name.startswith(one))
        for name in table.column_names
        if name in exact or name.startswith(begins)
    }


def part_fault(table: "pa.Table") -> str | None:
    """Describe the first fault in the rows of a file of the store; None if all rows are right."""
    wrong = column_fault(table, OF_ALL | known_columns(table))
    if wrong:
        return wrong
    numbers = np.flatnonzero(np.array(table["status"].to_pylist()) != "failed")
    valued = table.take(numbers)
    wrong = column_fault(valued, OF_VALUES, numbers) if len(numbers) else None
    if wrong:
        return wrong
    values: dict[str, dict[str | None, Any]] = {}
    for name in [name for name in AS_JSON if name in table.column_names]:
        values[name] = {None: None}
        for row, text in enumerate(table[name].to_pylist()):
            if text not in values[name]:
                try:
                    values[name][text] = checked(text, AS_JSON[name], name)
                except ValueError as error:
                    return f"row {row + 1}: {error}"
    faults = _contradictions(valued, values) if len(numbers) else iter(())
    return next((f"row {numbers[row] + 1}: {text}" for row, text in faults), None)


def _contradictions(
    table: "pa.Table", of_text: Mapping[str, Mapping[str | None, Any]]
) -> Iterator[tuple[int, str]]:
    """Yield the index and the fault of each contradictory row.

    `of_text` has the parsed JSON for each text, by column.
    """
    parameters = [of_text["parameters"][text] for text in table["parameters"].to_pylist()]
    names = [name for name in OF_VALUES if OF_VALUES[name] in (COST, COUNT)]
    names += ["order", "cutoff", *(name for name in SPLIT_PARTS if name in table.column_names)]
    columns = {name: np.array(table[name].to_pylist(), float) for name in names}
    columns["rho"] = np.array([own.get("rho", 0.5) for own in parameters])
    is_plain = np.array([not any(one in own for one in saved.UNLIKE_COUNTS) for own in parameters])
    yield from saved.contradictions(columns, is_plain)
    several = {STORED_NEES, STORED_SLICES} & of_text.keys()
    for row, own in enumerate(table.to_pylist() if several else ()):
        sums = of_text.get(STORED_NEES, {}).get(own.get(STORED_NEES))
        record = {name: own.get(f"{NEES}.{name}") for name in ("anees", "inside")}
        if sums and not fits_sums(record | {"mean": own[NEES], "sums": sums}):
            yield row, f"{NEES} does not follow from its sums"
        slicings = of_text.get(STORED_SLICES, {}).get(own.get(STORED_SLICES))
        wrong = saved.slices_fault(slicings or (), own)
        if wrong:
            yield row, wrong
    for name in PARAMETER_COLUMNS:
        for row, value in enumerate(table[name].to_pylist()):
            if value != parameters[row][name]:
                yield row, f"{name} is {value}, but parameters.{name} is {parameters[row][name]}"


# -------------------------------------------------------------------------------------------------
# Rows can be compared if they differ only in the compared labels.

TRUTH_DIGEST, ESTIMATE_DIGEST = (f"input.{role}.sha256" for role in ("truth", "estimate"))
"""Columns with the digests of truth and estimate (`tracks.coverage.digest`)."""


READ_AS_GIVEN = (
    *("time", "class", "region", "truth_class", "estimate_class", "time_tolerance"),
    *("where", "truth_where", "estimate_where", "day_begins"),
    "max_gap",
    *("on_duplicate", "on_invalid", "fix_cov", "missing_cov", "inner_cov", "decimal", "steps"),
    "ignore_regions",
    *saved.OF_THE_ESTIMATE,
)
"""Parameters in which jobs of one table are allowed to differ.

They say how files are read, or follow from the data of a file.
"""


def label_names(rows: "pd.DataFrame") -> list[str]:
    """Return the names of the labels."""
    return [name.removeprefix(LABEL) for name in rows.columns if name.startswith(LABEL)]


def shown_labels(names: Sequence[str], taken: Collection[str]) -> list[str]:
    """Return the column names under which a table shows labels.

    The prefix ``label.`` is left out. It is kept if the name of the label is in `taken`, or begins
    with ``label.`` itself.
    """
    return [LABEL + name if name in taken or name.startswith(LABEL) else name for name in names]


def with_parameters(rows: "pd.DataFrame") -> tuple["pd.DataFrame", list[str]]:
    """Return rows with a column for each parameter in which jobs differ, and the column names.

    Jobs with different parameters are never added up or compared. An added column has a dash where
    a job lacks the parameter or has no value.
    """
    having = rows[rows["status"] != "failed"]
    differing = [name for name in PARAMETER_COLUMNS if having[name].nunique() > 1]
    if "parameters" not in having:
        return rows, differing
    settings_of = {text: json.loads(text) for text in having["parameters"].dropna().unique()}
    names = {name for settings in settings_of.values() for name in settings}
    for name in sorted(names - {*PARAMETER_COLUMNS, *saved.ACCURACY, *READ_AS_GIVEN}):
        shown = {text: in_words(settings.get(name)) for text, settings in settings_of.items()}
        if len(set(shown.values())) > 1:
            rows = rows.assign(**{name: rows["parameters"].map(shown).fillna("-")})
            differing.append(name)
    return rows, differing


def in_words(value: object) -> str:
    """Format a parameter for a table."""
    if isinstance(value, list):
        return ",".join(map(in_words, value))
    if isinstance(value, dict):
        return ",".join(f"{name}={in_words(item)}" for name, item in value.items())
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, str):
        return value
    return "-" if value is None else json.dumps(value)


def truths(rows: "pd.DataFrame") -> "pd.Series[str]":
    """Return the truth of each job: the digest of its data, or its path if no digest is known."""
    import pandas as pd

    paths = rows["truth"]
    if TRUTH_DIGEST not in rows:
        return paths
    digests = rows[TRUTH_DIGEST]
    # A failed job has no digest. If another job has the same file, the digest of that job is used.
    known = pd.Series(digests.to_numpy(), index=paths).dropna()
    known = known[~known.index.duplicated(keep="last")]
    return digests.fillna(paths.map(known)).fillna(paths)


def run_ids(rows: "pd.DataFrame") -> "pd.Series[str]":
    """Return a text for each job; copies of a job have the same text (see `originals`)."""
    own = rows.index.to_series().astype(str)
    if ESTIMATE_DIGEST not in rows:
        return own
    estimates = (rows[ESTIMATE_DIGEST] + rows["parameters"]).fillna("")
    numbers = rows.reindex(columns=[*COPIED, *MISSED]).to_dict("records")
    return own.iloc[originals(zip(truths(rows), estimates, numbers, strict=True))].set_axis(
        own.index
    )


MISSED = "counts.missed", "judged.truth_states"
COPIED = ("total", *PARTS, "summary.mean_error", "summary.median_error")
"""Numbers of a run that are the same in its copies, because they do not depend on ids."""


def originals(runs: Iterable[tuple[str, str, Mapping[Any, Any]]]) -> list[int]:
    """Return for each run the index of the first run of which it is a copy, or its own index.

    A copy has the same truth and the same estimate; the ids of tracks can differ. If their digests
    differ, copies agree in all digits of their costs and errors. Round numbers are no evidence. A
    run without estimated states is never a copy, because it is no sign of a seed that was not set.

    Parameters
    ----------
    runs : iterable of tuple
        For each run: digest of the truth, digest of the estimate with its parameters or a blank,
        and its numbers by the columns of a row.
    """
    known: dict[object, int] = {}
    firsts = []
    for k, (truth, estimate, numbers) in enumerate(runs):
        cost = numbers["localisation"]
        keys: list[object] = [(truth, estimate)] if estimate else []
        if abs(cost - float(f"{cost:.5g}")) > 1e-12 * cost:
            keys.append((truth, *(str(numbers.get(name)) for name in COPIED)))
        missed, states = (numbers[name] for name in MISSED)
        if missed >= states and not numbers["false"]:
            keys = []
        firsts.append(next((known[key] for key in keys if key in known), k))
        known |= dict.fromkeys(keys, firsts[-1])
    return firsts


def about_copies(name: str, runs: Iterable[object]) -> Iterator[Notice]:
    """Yield a warning if some runs of a tracker are copies; copies are equal in `runs`."""
    copies = sum(count for count in Counter(runs).values() if count > 1)
    if copies:
        of = f" of {name}" if name else ""
        yield Notice(
            code="copies",
            text=f"{counted(copies, 'run')}{of} are copies of one another, with the same truth and "
            "the same estimate apart from ids",
            remedy="copies count as one run in intervals and tests; check the seeds of the runs",
        )


def same_data(
    names: tuple[str, str],
    digests: tuple[Sequence[str], Sequence[str]],
    brackets: tuple[Sequence[Interval], Sequence[Interval]],
) -> bool:
    """Return whether two results have the same estimates in all runs.

    Parameters
    ----------
    names : pair of str
        Names of the results, for the message.
    digests : pair of sequence of str
        For each result, the digest of the estimate of each run; blank if it is not known.
    brackets : pair of sequence of Interval
        For each result, the bracket of each run; both have the same unit.

    Raises
    ------
    SolverError
        A run has the same data in both results, but its brackets do not overlap.
    """
    alike = [bool(own) and own == other for own, other in zip(*digests, strict=True)]
    for same, own, other in zip(alike, *brackets, strict=True):
        if same and not (overlap(own, other) or equal(own, other)):
            shown = " and ".join(f"[{one.lower:.12g}, {one.upper:.12g}]" for one in (own, other))
            raise SolverError(
                f"{' and '.join(map(quoted, names))} have the same data, and their brackets "
                f"{shown} do not overlap: one of them is wrong; evaluate both again with this "
                "version"
            )
    return bool(alike) and all(alike)


def pair_numbers(
    rows: "pd.DataFrame",
    compared: Sequence[str],
    parameters: Sequence[str] = (),
    *,
    truth: bool = True,
) -> "pd.Series[int]":
    """Return a number for each job; jobs that can be compared have the same number.

    Jobs with the same number agree in truth, in `parameters`, and in all labels that are not in
    `compared`. If any jobs with the same number also agree in the labels in `compared`, they differ
    only in their own options. Jobs with different options then get different numbers.

    Parameters
    ----------
    rows : DataFrame
        Rows of a store.
    compared : sequence of str
        Labels in which jobs with the same number are allowed to differ.
    parameters : sequence of str
        Columns that are equal in all jobs with the same number.
    truth : bool
        Whether jobs with the same number must have the same truth.
    """
    rest = [LABEL + name for name in label_names(rows) if name not in compared]
    same = rows[[*rest, *parameters]].assign(_truth=truths(rows) if truth else "")
    numbers = same.groupby(list(same), dropna=False).ngroup()
    own = rows[[LABEL + name for name in compared]].assign(_pair=numbers)
    if own.duplicated().any():  # some jobs differ only in their own options
        same = same.assign(_options=rows["options"])
        numbers = same.groupby(list(same), dropna=False).ngroup()
    return numbers
