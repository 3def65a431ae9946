"""``evaluate_many``: thousands of small pairs, evaluated together."""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from tgospa_eval.api.batch_row import PATIENCE
from tgospa_eval.api.evaluate import TrackPair, evaluate_sides, noticed, read_sides
from tgospa_eval.api.keywords import requested, with_options
from tgospa_eval.api.options import OF_EVALUATE, Request
from tgospa_eval.api.reading import align_sides, display_names, read_pair
from tgospa_eval.api.report import as_frame
from tgospa_eval.api.resolve import ResolvedRequest, resolve_request
from tgospa_eval.api.result import ByClass, Result
from tgospa_eval.campaign.pairs import named_sides, runs_in_memory
from tgospa_eval.campaign.row import Row
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.machine import cores
from tgospa_eval.common.notices import Notice, warn_user
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.words import counted
from tgospa_eval.engines import Processes, spread
from tgospa_eval.errors import ConfigError, InputError, TgospaError
from tgospa_eval.evaluation.joined import JoinedPairs, can_be_joined, is_like
from tgospa_eval.quoting import listed, quoted
from tgospa_eval.results.records import Costs

if TYPE_CHECKING:
    from typing import Unpack

    import pandas as pd

    from tgospa_eval.api.option_types import EvaluateManyOptions
    from tgospa_eval.formats.objects import Components, Runs

CHUNK = 100
"""Number of pairs that are evaluated together."""

SMALL = 10_000
"""Largest number of states of a pair that is evaluated together with other pairs."""

FEW = 3
"""Largest number of runs that a warning names. Further runs are only counted."""

SIZES = ("sizes.steps", "judged.steps", "sizes.truth_states", "sizes.estimate_states")
"""Columns with counts: all steps, steps of the horizon, true states, estimated states."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Evaluations:
    """Values of many pairs in a table; ``[run]`` makes the `Result` of one pair.

    Truth and estimate of each pair are kept as they were given, and read again for a `Result`.

    Parameters
    ----------
    runs : tuple of str
        Names of the pairs, in order.
    rows : tuple of dict
        A row of the table for each pair: its values, with the names of the columns as keys.
    warnings : tuple of Notice
        Warnings. Each text occurs once, and names the runs to which it applies.
    pairs : tuple of pairs
        Truth and estimate of each pair, as they were given.
    resolved, mapping : ResolvedRequest, sequence
        How the pairs are read and evaluated.
    """

    runs: tuple[str, ...]
    rows: tuple[Row, ...]
    warnings: tuple[Notice, ...]
    pairs: tuple[tuple[Any, Any], ...]
    resolved: ResolvedRequest
    mapping: "Components | None" = None

    def __len__(self) -> int:
        return len(self.runs)

    def __iter__(self) -> Iterator[Result]:
        return map(self.__getitem__, range(len(self)))

    def __contains__(self, run: object) -> bool:
        return run in self.runs

    def __getitem__(self, run: "int | str") -> Result:
        """Return the result of a pair, by its index or name.

        The result equals that of `evaluate`, but no Python warning is issued.

        Raises
        ------
        KeyError, IndexError
            There is no such pair.
        """
        if isinstance(run, str):
            if run not in self.runs:
                raise KeyError(run)
            run = self.runs.index(run)
        sides = read_sides(self.resolved, *self.pairs[run], Stopwatch(), mapping=self.mapping)
        result = evaluate_sides(self.resolved, sides, Stopwatch())
        assert not isinstance(result, ByClass)  # `evaluate_many` refuses `by`
        return result

    def table(self) -> "pd.DataFrame":
        """Return a row for each pair: values, bounds, parts and counts as in `Batch.rows`.

        The column ``warnings`` has the codes of the warnings about the pair.
        """
        return as_frame({name: [row[name] for row in self.rows] for name in self.rows[0]})

    def __str__(self) -> str:
        proven = sum(row["certified"] for row in self.rows)
        values = [row["normalised.tgospa"] for row in self.rows]
        return (
            f"{counted(len(self), 'pair')}, {proven:,} proven exact: TGOSPA per step "
            f"{'at most ' * (proven < len(self))}{min(values):.4g} to {max(values):.4g}, "
            f"mean {sum(values) / len(values):.4g}"
        )

    __repr__ = __str__


@with_options("by", "jobs", *OF_EVALUATE)
def evaluate_many(
    truth: "Runs | Sequence[tuple[Any, Any]] | Mapping[str, tuple[Any, Any]]",
    estimate: "Runs | None" = None,
    cutoff: float | None = None,
    order: float = 2.0,
    switch_penalty: float | None = None,
    *,
    mapping: "Components | None" = None,
    jobs: int | None = None,
    **options: "Unpack[EvaluateManyOptions]",
) -> Evaluations:
    """Compute TGOSPA of many pairs, with the same values and bounds as `evaluate`.

    Small pairs are evaluated together, which takes a fraction of the time of a loop. Other pairs
    are evaluated one by one. The results equal those of `evaluate` bit by bit.

    Parameters
    ----------
    truth : sequence of pairs, mapping, sequence of sides, array or table
        Without `estimate`: pairs of truth and estimate, or a mapping from names to such pairs. With
        `estimate`: the truth of each run as a sequence, an array with the axes run, step, object
        and state column, or a table with a column ``run``; or a single truth for all runs.
    estimate : sequence of sides, array or table, optional
        The estimates of the same runs.
    cutoff, order, switch_penalty : float, optional
        Parameters of `evaluate`.
    mapping : sequence of int, or pair of such, optional
        Indices of the state components to compare, as in `evaluate`.
    jobs : int, optional
        Number of processes. Several processes are used only if the work takes more than some
        seconds. The default is the number of cores.

    Returns
    -------
    Evaluations
        The table of all pairs; ``[run]`` makes the `Result` of one pair.

    Warns
    -----
    TgospaWarning
        Data look wrong; each text is given once.

    Raises
    ------
    ConfigError
        A parameter is out of range, or a name is unknown.
    InputError
        A side is wrong, truth and estimate of a pair do not fit each other, or `truth` and
        `estimate` have different runs.
    TypeError
        A keyword is unknown.

    Examples
    --------
    >>> many = evaluate_many([(truth, estimate), (truth, other)], cutoff=10, switch_penalty=5)
    >>> many.table()[["run", "tgospa", "missed"]]
    >>> many[0].worst()
    """
    given = {"cutoff": cutoff, "order": order, "switch_penalty": switch_penalty, **options}
    jobs = requested(given | {"jobs": jobs}).jobs
    request = requested(given | {"jobs": 1})
    resolved = resolve_request(request)
    runs, pairs = _named_pairs(truth, estimate)
    chunks = [
        (begin, runs[begin : begin + CHUNK], pairs[begin : begin + CHUNK])
        for begin in range(0, len(runs), CHUNK)
    ]
    made = sorted(_worked(partial(_chunk, request, mapping), chunks, jobs or cores()))
    each = [one for _, part in made for one in part]
    warnings = _by_kind((run, notices) for run, (_, notices) in zip(runs, each, strict=True))
    warn_user(warnings)
    return Evaluations(
        runs=tuple(runs),
        rows=tuple({"run": run, **row} for run, (row, _) in zip(runs, each, strict=True)),
        warnings=warnings,
        pairs=tuple(pairs),
        resolved=resolved,
        mapping=mapping,
    )


Chunk = tuple[int, list[str], list[tuple[Any, Any]]]
Numbers = tuple[Row, tuple[Notice, ...]]


def _named_pairs(truth: Any, estimate: Any) -> tuple[list[str], list[tuple[Any, Any]]]:
    """Return the names of the pairs, and the pairs.

    Raises
    ------
    InputError
        There is no pair, or an item is not a pair.
    """
    if estimate is not None:
        if any(
            isinstance(side, (list, np.ndarray)) and not len(side) for side in (truth, estimate)
        ):
            raise InputError("there is no run to evaluate")
        names, truths, own = runs_in_memory(truth, {"estimate": estimate})
        return [name or "1" for name in names], list(zip(truths, own["estimate"], strict=True))
    if isinstance(truth, Mapping):
        named = named_sides(truth)
        names, pairs = [*named], [*named.values()]
    elif isinstance(truth, (str, bytes)) or not isinstance(truth, Iterable):
        raise InputError(
            f"pairs are {type(truth).__name__}: must be a sequence of (truth, estimate), or a "
            "mapping from names to such pairs; or give truths and estimates"
        )
    else:
        pairs = list(truth)
        names = [f"{k:0{len(str(len(pairs)))}}" for k in range(1, len(pairs) + 1)]
    if not pairs:
        raise InputError("there is no pair to evaluate")
    for name, pair in zip(names, pairs, strict=True):
        if not isinstance(pair, (tuple, list)) or len(pair) != 2:
            raise InputError(
                f"run {quoted(name)}: a pair is (truth, estimate), not {type(pair).__name__}; runs "
                "of each side are given as evaluate_many(truths, estimates)"
            )
    return names, [(pair[0], pair[1]) for pair in pairs]


def _worked(work: Any, chunks: list[Chunk], jobs: int) -> Iterator[tuple[int, list[Numbers]]]:
    """Yield what `work` returns for each chunk; several processes share work that takes long."""
    begin = time.monotonic()
    for done, chunk in enumerate(chunks):
        left = len(chunks) - done
        spent = time.monotonic() - begin
        if done and min(jobs, left) > 1 and spent / done * left > 2 * PATIENCE:
            yield from spread(work, chunks[done:], work, Processes(jobs))
            return
        yield work(chunk)


def _chunk(
    request: Request, mapping: "Components | None", chunk: Chunk
) -> tuple[int, list[Numbers]]:
    """Return the index of the first pair of a chunk, and the row and warnings of each pair."""
    resolved = resolve_request(request)
    begin, runs, pairs = chunk
    read = []
    for run, pair in zip(runs, pairs, strict=True):
        with _of_run(run):
            sides = read_pair(resolved, *pair, mapping=mapping, advise=False)
            read.append((pair, sides, *align_sides(resolved, sides, display_names(pair))))
    small = [
        k
        for k, (_, _, aligned, request_of_pair) in enumerate(read)
        if can_be_joined(request_of_pair) and sum(len(one.step) for one in aligned.read) <= SMALL
    ]
    costs: dict[int, Costs | None] = {}
    sound = np.zeros(len(read), bool)
    while small:
        first = read[small[0]]
        alike = [k for k in small if is_like(read[k][2], first[2])] or small[:1]
        small = [k for k in small if k not in alike]
        with suppress(ConfigError):  # pairs that cannot be joined are evaluated one by one later
            joined = JoinedPairs([read[k][2] for k in alike], first[3])
            sound[alike] = joined.sound()
            costs |= dict(zip(alike, joined.costs(), strict=True))
    made = []
    for k, run in enumerate(runs):
        with _of_run(run):
            pair_read = noticed(*read[k], sound=bool(sound[k]))
            made.append(_numbers(resolved, pair_read, costs.get(k)))
    return begin, made


@contextmanager
def _of_run(run: str) -> Iterator[None]:
    """Put the name of the run before each line of an error."""
    try:
        yield
    except TgospaError as error:
        raise type(error)(*(f"run {quoted(run)}: {line}" for line in error.args)) from None


def _numbers(resolved: ResolvedRequest, sides: TrackPair, costs: Costs | None) -> Numbers:
    """Return the row and warnings of a pair. If `costs` is None, evaluate the pair by itself."""
    warnings, aligned = sides.warnings, sides.fitted.alignment
    if costs is None:
        result = evaluate_sides(resolved, sides, Stopwatch())
        costs, warnings = result.proof, result.warnings
        steps, objects = result.evaluated_on.steps, result.objects
    else:
        steps = len(sides.fitted.axis.horizon.times) or len(aligned.truth.times)
        objects = len(aligned.truth.step), len(aligned.estimate.step)
    row = costs.numbers(sides.request.solver.gap, max(steps, 1))
    row |= dict(zip(SIZES, (len(aligned.truth.times), steps, *objects), strict=True))
    return row | {"warnings": " ".join(notice.code for notice in warnings)}, warnings


def _by_kind(each: Iterable[tuple[str, tuple[Notice, ...]]]) -> tuple[Notice, ...]:
    """Return each warning once, with the names of the runs to which it applies."""
    kinds: dict[Notice, list[str]] = {}
    for run, notices in each:
        for notice in dict.fromkeys(notices):
            kinds.setdefault(notice, []).append(run)
    return tuple(notice.about(f"run {listed(runs, FEW)}") for notice, runs in kinds.items())
