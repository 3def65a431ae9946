"""TGOSPA, the metric between two sets of trajectories, exact and with proof.

The public names are imported when they are used, so that ``tgospa-eval --help`` stays quick.
"""

from typing import TYPE_CHECKING

from tgospa_eval._version import __version__ as __version__
from tgospa_eval.common.registry import lazy

if TYPE_CHECKING:  # `as` makes a name public for type checkers
    from tgospa_eval.api.batch import batch as batch
    from tgospa_eval.api.compare import compare as compare
    from tgospa_eval.api.compare import sweep as sweep
    from tgospa_eval.api.evaluate import evaluate as evaluate
    from tgospa_eval.api.evaluate_many import evaluate_many as evaluate_many
    from tgospa_eval.api.gate import gate as gate
    from tgospa_eval.api.recorder import Recorder as Recorder
    from tgospa_eval.api.report import Sweep as Sweep
    from tgospa_eval.api.result import Result as Result
    from tgospa_eval.api.sensors import associate as associate
    from tgospa_eval.api.sensors import reduce as reduce
    from tgospa_eval.errors import ConfigError as ConfigError
    from tgospa_eval.errors import InputError as InputError
    from tgospa_eval.errors import SolverError as SolverError
    from tgospa_eval.errors import TgospaError as TgospaError
    from tgospa_eval.errors import TgospaWarning as TgospaWarning
    from tgospa_eval.formats import read_trajectories as read_trajectories
    from tgospa_eval.proof.check import verify as verify
    from tgospa_eval.results.explanation import Explanation as Explanation
    from tgospa_eval.simulation.settings import simulate as simulate
    from tgospa_eval.solvers.certified import Certified as Certified
    from tgospa_eval.solvers.exact import Exact as Exact
    from tgospa_eval.solvers.sinkhorn import Sinkhorn as Sinkhorn
    from tgospa_eval.tracks.trajectories import Trajectories as Trajectories

_HOME = {
    "Certified": "solvers.certified",
    "ConfigError": "errors",
    "Exact": "solvers.exact",
    "Explanation": "results.explanation",
    "InputError": "errors",
    "Recorder": "api.recorder",
    "Result": "api.result",
    "Sinkhorn": "solvers.sinkhorn",
    "SolverError": "errors",
    "Sweep": "api.report",
    "TgospaError": "errors",
    "TgospaWarning": "errors",
    "Trajectories": "tracks.trajectories",
    "associate": "api.sensors",
    "batch": "api.batch",
    "compare": "api.compare",
    "evaluate": "api.evaluate",
    "evaluate_many": "api.evaluate_many",
    "gate": "api.gate",
    "read_trajectories": "formats",
    "reduce": "api.sensors",
    "simulate": "simulation.settings",
    "sweep": "api.compare",
    "verify": "proof.check",
}

__all__ = sorted([*_HOME, "__version__"])


__getattr__ = lazy(__name__, _HOME)


def __dir__() -> list[str]:
    return __all__
