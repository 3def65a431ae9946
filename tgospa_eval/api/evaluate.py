"""One evaluation: read, align, fit, diagnose, solve, report, each once, whoever asks."""

import os
import shutil
import tempfile
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from tgospa_eval.api.in_parts import check_parts, evaluate_in_parts, parts_in_words
from tgospa_eval.api.keywords import requested, with_options
from tgospa_eval.api.notices import about, about_same, pair_notices, slow_notice
from tgospa_eval.api.resolve import Settings, called, make_settings
from tgospa_eval.api.result import ByClass, Result, ResultInParts, result_of
from tgospa_eval.common.frozen import dataclass, recast, replace
from tgospa_eval.common.notices import Notice, warn_user
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.common.words import parsed_size
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.by_class import add_up
from tgospa_eval.evaluation.evaluate import evaluate_fitted
from tgospa_eval.evaluation.prepare import Fitted, fit
from tgospa_eval.evaluation.request import EvaluationRequest
from tgospa_eval.evaluation.sides import is_path
from tgospa_eval.formats import Reading

if TYPE_CHECKING:
    from tgospa_eval.evaluation.sides import Components, TrajectoriesLike

Notify = Callable[[Notice], None]
"""What to do with a notice, or a warning."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SidesRead:
    """Truth and estimate, ready to be evaluated.

    Parameters
    ----------
    read : pair of Reading
        As they were read.
    fitted : Fitted
        The same, on one grid.
    request : EvaluationRequest
        What is asked of them.
    files : dict
        Paths of truth and estimate; None of what is no file.
    warnings : tuple of Notice
        What looks wrong with them.
    notices : tuple of str
        How they were read, and what nobody chose.
    """

    read: tuple[Reading, ...]
    fitted: Fitted
    request: EvaluationRequest
    files: dict[str, str | None]
    warnings: tuple[Notice, ...]
    notices: tuple[str, ...]

    @property
    def records(self) -> list[dict[str, Any]]:
        """What a result records of both files."""
        return [side.record for side in self.read]


def read_sides(
    settings: Settings,
    truth: "TrajectoriesLike | Reading",
    estimate: "TrajectoriesLike",
    stopwatch: Stopwatch,
    notify: Notify | None = None,
    *,
    mapping: "Components | None" = None,
    known: dict[str, Reading] | None = None,
) -> SidesRead:
    """Read truth and estimate, align and fit them, and say what looks wrong.

    Parameters
    ----------
    settings : Settings
        The request.
    truth, estimate : path, Trajectories, DataFrame, array, mapping or set of tracks
        The two sides; the truth may be what `Settings.read_side` made of it.
    stopwatch : Stopwatch
        Running clock.
    notify : callable, optional
        What to do with what the user should know.
    mapping : sequence of int, or pair of such, optional
        Of tracks with state vectors the components to compare.
    known : dict, optional
        The last truth by its path, for several estimates of it: it is read once.

    Raises
    ------
    TgospaError
        Something is wrong with the sides, or the options do not fit them.
    """
    given = (truth, estimate)
    with stopwatch.span("read"):
        sides = settings.read(*given, mapping=mapping, advise=notify is not None, known=known)
    names = called(given)
    fitted, request = settings.fit(sides, names)
    notices = [
        *(notice for name, side in zip(names, sides, strict=True) for notice in about(name, side)),
        *(about_same(*fitted.read) if is_path(truth) or truth is not estimate else ()),
        *pair_notices(fitted, request, sides),
        *(() if request.solver.referee else slow_notice()),
    ]
    for notice in notices if notify else ():
        notify(notice)  # type: ignore[misc]
    paths = (name if is_path(side) else None for name, side in zip(names, given, strict=True))
    return SidesRead(
        read=sides,
        fitted=fitted,
        request=request,
        files=dict(zip(("truth", "estimate"), paths, strict=True)),
        warnings=tuple(notice for notice in notices if notice.code),
        notices=tuple(notice.sentence for notice in notices if not notice.code),
    )


def evaluate_sides(
    settings: Settings, sides: SidesRead, stopwatch: Stopwatch, notify: Notify | None = None
) -> Result | ByClass:
    """Solve, prove and report; of each class by itself, if that is asked for.

    `notify` takes what the solution shows.
    """
    result: Result | ByClass
    if settings.reading.by_class:
        result = _evaluate_classes(sides, stopwatch)
    else:
        result = result_of(
            evaluate_fitted(sides.fitted, sides.request, files=sides.records, stopwatch=stopwatch)
        )
    for notice in result.warnings if notify else ():
        notify(notice)  # type: ignore[misc]
    return replace(
        result,
        warnings=(*sides.warnings, *result.warnings),
        notices=sides.notices,
        files=sides.files,
        calibration=settings.similarity,
    )


def _evaluate_classes(sides: SidesRead, stopwatch: Stopwatch) -> ByClass:
    """One evaluation for each class, and their sum."""
    from tgospa_eval.common.words import natural

    # What the distance takes from the data, it takes from all.
    request = replace(sides.request, distance=sides.fitted.distance)
    truth, estimate = sides.read
    read_s = stopwatch.elapsed()
    results = {}
    classes = sorted({*truth.classes, *estimate.classes}, key=natural) or [""]
    for number, name in enumerate(classes):
        part = stopwatch.beside()
        with stopwatch.progress.part(f"class {name}", number, len(classes)):
            fitted = fit(truth.of_class(name), estimate.of_class(name), request)
            results[name] = result_of(evaluate_fitted(fitted, request, stopwatch=part))
        stopwatch.absorb(part)
    return recast(add_up(results, sides.records, read_s), ByClass)


@with_options()
def evaluate(
    truth: "TrajectoriesLike",
    estimate: "TrajectoriesLike",
    cutoff: float | None = None,
    order: float = 2.0,
    switch_penalty: float | None = None,
    *,
    mapping: "Components | None" = None,
    memory: "float | str | None" = None,
    scheduler: str | None = None,
    **options: Any,
) -> Result:
    """TGOSPA between two sets of trajectories, with proven bounds.

    Every option of ``tgospa-eval evaluate`` is a keyword, by its name.

    Parameters
    ----------
    truth, estimate : path, Trajectories, DataFrame, array, mapping or set of tracks
        A file, or what `read_trajectories` made of one; a table of pandas, Polars or another that
        Arrow knows, in the long form ``id, t, x[, y[, z]]``; an array or tensor (T, k, d) with NaN
        for absent, or a pair ``(times, array)``; a mapping from id to an array (T, d), or to a
        pair ``(times, array)``; tracks or ground-truth paths of Stone Soup (see `mapping`).
        Arrays and tables are taken to have the columns that the distance needs.
    cutoff : float, optional
        c > 0, in the unit of the distance; 10.0 by default, 0.5 with ``"iou"``.
    order : float
        p >= 1.
    switch_penalty : float, optional
        gamma >= 0, in the unit of the distance; 2.0 by default, 0.5 with ``"iou"``.
    mapping : sequence of int, or pair of such, optional
        Of tracks with state vectors the components to compare: ``(0, 2)`` for x and y of
        ``(x, vx, y, vy)``; a pair where truth and estimate have theirs in other places.
    memory : str or float, optional
        Memory that the evaluation may take, ``"4GB"``, or a number of GB; half of the machine's by
        default. Where both sides are paths, folders of Parquet or CSV files, and files that would
        take more, are read and evaluated in parts, by as many processes as `jobs` says.
    scheduler : str, optional
        For data in parts: address of a Dask cluster, whose workers take the place of processes.

    Returns
    -------
    Result
        Value, bracket, decomposition, tables; with ``by="class"`` the sum of such, `ByClass`; of
        data in parts `ResultInParts`, whose tables are files that go with it.

    Warns
    -----
    TgospaWarning
        Something looks wrong with the data: see `Result.warnings`.

    Raises
    ------
    ConfigError
        A parameter is out of range, a name is unknown, or an option is not for such data.
    InputError
        A file is wrong, or the two sides do not fit: other columns, other kinds of time, states
        out of range.
    TypeError
        There is no such keyword.
    """
    given = {"cutoff": cutoff, "order": order, "switch_penalty": switch_penalty, **options}
    limit = None if memory is None else parsed_size(memory)
    request = requested({**given, "memory": limit, "scheduler": scheduler})
    settings, stopwatch = make_settings(request), Stopwatch()
    result: Result | ByClass | ResultInParts
    why = None
    if is_path(truth) and is_path(estimate):
        paths = os.fspath(truth), os.fspath(estimate)
        why = parts_in_words(paths, request)
    if why is not None:
        check_parts(request, why)
        folder = tempfile.mkdtemp(prefix="tgospa-eval-")
        try:
            in_parts = evaluate_in_parts(
                paths, request, settings, Path(folder), stopwatch, kept=True
            )
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        weakref.finalize(in_parts.tables, shutil.rmtree, folder, ignore_errors=True)
        result = recast(in_parts, ResultInParts)
    elif scheduler is not None:
        raise ConfigError("scheduler is for data in parts: folders of tables")
    else:
        sides = read_sides(settings, truth, estimate, stopwatch, mapping=mapping)
        result = evaluate_sides(settings, sides, stopwatch)
    warn_user(result.warnings)
    return cast("Result", result)
