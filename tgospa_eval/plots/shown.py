"""A figure that a notebook shows by itself, without %matplotlib and without a window."""

import io
from typing import Any

import matplotlib
from matplotlib.figure import Figure


class ShownFigure(Figure):
    """As a cell of a notebook ends with it; pyplot, where someone uses it, has its own way.

    It is drawn with the settings with which it was made, whatever those of the user are.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        usual = matplotlib.rcParamsDefault
        self._settings = {
            name: value
            for name, value in matplotlib.rcParams.items()
            if name in usual and not name.startswith("backend") and value != usual[name]
        }

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """A sharp picture, and the size at which it is shown."""
        target = io.BytesIO()
        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(self._settings)
            self.savefig(target, format="png", dpi=2 * SHARP, metadata={"Software": None})
        wide, tall = (round(SHARP * inches) for inches in self.get_size_inches())
        return target.getvalue(), {"width": wide, "height": tall}


SHARP = 96
"""Per inch on a screen."""
