"""TGOSPA, the metric between two sets of trajectories, exact and with proof.

The public names are imported when they are used, so that ``tgospa-eval --help`` stays quick.
"""

from typing import TYPE_CHECKING, Any

from tgospa_eval._version import __version__

if TYPE_CHECKING:
    from tgospa_eval.api.batch import batch
    from tgospa_eval.api.compare import compare
    from tgospa_eval.api.evaluate import evaluate
    from tgospa_eval.api.gate import gate
    from tgospa_eval.api.recorder import Recorder
    from tgospa_eval.api.sweep import sweep
    from tgospa_eval.errors import (
        ConfigError,
        InputError,
        SolverError,
        TgospaError,
        TgospaWarning,
    )
    from tgospa_eval.formats import read_trajectories
    from tgospa_eval.proof.check import verify
    from tgospa_eval.results.explanation import Explanation
    from tgospa_eval.results.result import Result
    from tgospa_eval.results.sweep import Sweep
    from tgospa_eval.simulation.settings import simulate
    from tgospa_eval.solvers.certified import Certified
    from tgospa_eval.solvers.exact import Exact
    from tgospa_eval.solvers.sinkhorn import Sinkhorn
    from tgospa_eval.tracks.trajectories import Trajectories

_HOME = {
    "Certified": "solvers.certified",
    "ConfigError": "errors",
    "Exact": "solvers.exact",
    "Explanation": "results.explanation",
    "InputError": "errors",
    "Recorder": "api.recorder",
    "Result": "results.result",
    "Sinkhorn": "solvers.sinkhorn",
    "SolverError": "errors",
    "Sweep": "results.sweep",
    "TgospaError": "errors",
    "TgospaWarning": "errors",
    "Trajectories": "tracks.trajectories",
    "batch": "api.batch",
    "compare": "api.compare",
    "evaluate": "api.evaluate",
    "gate": "api.gate",
    "read_trajectories": "formats",
    "simulate": "simulation.settings",
    "sweep": "api.sweep",
    "verify": "proof.check",
}

__all__ = [
    "Certified",
    "ConfigError",
    "Exact",
    "Explanation",
    "InputError",
    "Recorder",
    "Result",
    "Sinkhorn",
    "SolverError",
    "Sweep",
    "TgospaError",
    "TgospaWarning",
    "Trajectories",
    "__version__",
    "batch",
    "compare",
    "evaluate",
    "gate",
    "read_trajectories",
    "simulate",
    "sweep",
    "verify",
]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
