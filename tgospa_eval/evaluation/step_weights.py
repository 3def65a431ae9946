"""What a Python user gives as weights of steps, as `WeightsByTime`."""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from tgospa_eval.common.words import more
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.sides import as_frame
from tgospa_eval.problem.problem import Floats
from tgospa_eval.tracks.step_weights import WeightsByTime, repeated

if TYPE_CHECKING:
    import pandas as pd

    from tgospa_eval.evaluation.sides import ArrowTable

StepWeightsLike: TypeAlias = (
    "Mapping[object, float] | pd.Series[float] | pd.DataFrame | ArrowTable | Floats | str | "
    "os.PathLike[str]"
)
"""Time to weight, a table ``t, weight[, switch_weight]``, an array (T,), a path."""

GIVEN = "step_weights"


def as_step_weights(given: "StepWeightsLike | None") -> WeightsByTime | None:
    """Any accepted form of the weights of steps.

    Raises
    ------
    ConfigError
        It is of no accepted type.
    InputError
        A time or a weight is none, or a time is there twice.
    """
    if given is None:
        return None
    if isinstance(given, (str, os.PathLike)):
        from tgospa_eval.formats.text.step_weights import read_step_weights

        return read_step_weights(os.fspath(given))
    import pandas as pd  # here: files do without

    if isinstance(given, pd.Series):  # by its index, as a mapping
        given = dict(given.items())
    frame = as_frame(given, GIVEN)
    if frame is None and isinstance(given, Mapping):
        frame = pd.DataFrame({"t": list(given.keys()), "weight": list(given.values())})
    if frame is None and isinstance(given, (np.ndarray, list, tuple)):
        if np.ndim(given) != 1:
            raise InputError(
                f"{GIVEN}: an array of shape {np.shape(given)}; one weight a step, (T,)"
            )
        frame = pd.DataFrame({"t": np.arange(len(given)), "weight": given})
    if frame is None:
        raise ConfigError(
            f"{GIVEN} is of the type {type(given).__name__}: must be a mapping from time to "
            "weight, a table with the columns t and weight, an array (T,) or a path"
        )
    return _of_frame(frame)


def _of_frame(frame: "pd.DataFrame") -> WeightsByTime:
    """A table ``t, weight[, switch_weight]``."""
    from tgospa_eval.formats.frames import frame_times

    columns = {str(name): frame[name] for name in frame.columns}
    lacking = [name for name in ("t", "weight") if name not in columns]
    if lacking:
        raise InputError(f"{GIVEN}: no column {lacking[0]}; it has t, weight and switch_weight")
    times = frame_times(columns["t"], GIVEN)
    again = repeated(times.value)
    if again is not None:
        row, _, count = again
        shown = columns["t"].iloc[row]
        raise InputError(f"{GIVEN}, row {row}: t = {shown} is there twice{more(count)}")
    cost = _weights(columns["weight"], "weight")
    switch = _weights(columns.get("switch_weight", columns["weight"]), "switch_weight")
    return WeightsByTime(times=times.value, cost=cost, switch=switch, clock=times.clock, name=GIVEN)


def _weights(column: "pd.Series", header: str) -> Floats:
    try:
        values = column.to_numpy(dtype=np.float64, na_value=np.nan)
    except (TypeError, ValueError):
        raise InputError(f'{GIVEN}, column "{header}": not numbers') from None
    odd = np.flatnonzero(~((values >= 0) & np.isfinite(values)))
    if len(odd):
        raise InputError(
            f'{GIVEN}, row {odd[0]}, column "{header}": {values[odd[0]]:g}{more(len(odd))}; '
            "write a finite number >= 0, 0 for a step that does not count"
        )
    return values
