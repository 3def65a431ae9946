"""Pictures as functions of a result: ``plot_costs(result)`` is ``result.plot_costs()``."""

from collections.abc import Callable
from typing import Any

PICTURES = ("plot_costs", "plot_lanes", "plot_plane", "plot_cumulative", "plot_worst", "plot_nees")


def __getattr__(name: str) -> Callable[..., Any]:
    """Return the function with this name, whose first parameter is a result."""
    if name not in PICTURES:
        raise AttributeError(name)

    def draw(result: Any, *given: Any, **settings: Any) -> Any:
        return getattr(result, name)(*given, **settings)

    return draw
