"""Evaluations over a range of one parameter."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tgospa_eval.api.evaluate import Notify, read_sides
from tgospa_eval.api.keywords import requested, with_options
from tgospa_eval.api.options import ALONE, Request
from tgospa_eval.api.resolve import ResolvedRequest, resolve_request
from tgospa_eval.common.arrays import Floats
from tgospa_eval.common.notices import warn_user
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.sweep import in_order, sweep_fitted
from tgospa_eval.problem.metric_family import Parameters
from tgospa_eval.results.sweep import Sweep

if TYPE_CHECKING:
    from typing import Unpack

    from tgospa_eval.api.option_types import SweepOptions
    from tgospa_eval.formats.objects import Components, TrajectoriesLike

Values: TypeAlias = float | Sequence[float] | Floats

ONE_EVALUATION = ("by", "preprocess", *ALONE)
"""Options that are not for a sweep."""


def swept_parameters(
    request: Request, name: str, values: Sequence[float]
) -> tuple[ResolvedRequest, tuple[Parameters, ...]]:
    """The settings of a point in the middle, and the parameters of all points by value.

    Raises
    ------
    ConfigError, InputError
        As of an evaluation; there is no value, one is repeated or out of its range.
    """
    middle: dict[str, Any] = {name: sorted(values)[len(values) // 2]} if values else {}
    resolved = resolve_request(replace(request, by=None, **middle))
    others = {k: v for k, v in vars(resolved.evaluation.parameters).items() if k != name}
    return resolved, in_order(name, values, others)


def sweep_sides(
    resolved: ResolvedRequest,
    name: str,
    parameters: tuple[Parameters, ...],
    sides: "tuple[TrajectoriesLike, TrajectoriesLike]",
    stopwatch: Stopwatch,
    notify: Notify | None = None,
    *,
    mapping: "Components | None" = None,
) -> Sweep:
    """Read both sides once, and evaluate them at each point; arguments as of `read_sides`."""
    read = read_sides(resolved, *sides, stopwatch, notify, mapping=mapping)
    found = sweep_fitted(
        read.fitted, read.request, name, parameters, files=read.records, stopwatch=stopwatch
    )
    return replace(found, warnings=read.warnings)


@with_options(*ONE_EVALUATION)
def sweep(
    truth: "TrajectoriesLike",
    estimate: "TrajectoriesLike",
    cutoff: "Values | None" = None,
    order: "Values" = 2.0,
    switch_penalty: "Values | None" = None,
    *,
    rho: "Values" = 0.5,
    mapping: "Components | None" = None,
    **options: "Unpack[SweepOptions]",
) -> Sweep:
    """TGOSPA over a range of one parameter, each point with proven bounds.

    Exactly one of `cutoff`, `order`, `switch_penalty` and `rho` is a sequence of values; everything
    else is as for `evaluate`. Each point is what `evaluate` gives; the near pairs are searched
    once, and over `rho`, which changes no optimal assignment while all is judged, the problem is
    solved once.

    Parameters
    ----------
    truth, estimate : path, Trajectories, DataFrame, array, mapping or set of tracks
        As for `evaluate`.
    cutoff, order, switch_penalty, rho : float or sequence of float
        One of them is a sequence, in any order, without repetitions.
    mapping : sequence of int, or pair of such, optional
        As for `evaluate`. A time limit holds for each point.

    Returns
    -------
    Sweep
        Points in the order of the values.

    Warns
    -----
    TgospaWarning
        As `evaluate`, for a value in the middle.

    Raises
    ------
    ConfigError, InputError, TypeError
        As for `evaluate`; none or several of the four are sequences; a value is repeated.
    """
    given: dict[str, Any] = {
        "cutoff": cutoff,
        "order": order,
        "switch_penalty": switch_penalty,
        "rho": rho,
    }
    swept = [name for name, value in given.items() if np.ndim(value)]
    if len(swept) != 1:
        raise ConfigError(
            "one of cutoff, order, switch_penalty and rho must be a sequence of values, the others "
            f"numbers; {' and '.join(swept) or 'none'} is a sequence"
        )
    name = swept[0]
    values = [float(value) for value in given.pop(name)]
    resolved, parameters = swept_parameters(requested({**given, **options}), name, values)
    found = sweep_sides(resolved, name, parameters, (truth, estimate), Stopwatch(), mapping=mapping)
    warn_user(found.warnings)
    return found
