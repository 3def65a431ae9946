"""Conversion of files and objects to Trajectories.

The package has a reader for each format, the options of reading, and the result, a `Reading`.
The public names are imported when they are used, as the command line needs only the names of the
formats.
"""

from typing import TYPE_CHECKING

from tgospa_eval.common.registry import lazy
from tgospa_eval.formats.registry import FORMATS as FORMATS

if TYPE_CHECKING:  # `import x as x` makes x public for type checkers
    from tgospa_eval.formats.objects import read as read
    from tgospa_eval.formats.objects import read_trajectories as read_trajectories
    from tgospa_eval.formats.objects import runs_inside as runs_inside
    from tgospa_eval.formats.options import ROLES as ROLES
    from tgospa_eval.formats.options import ReadOptions as ReadOptions
    from tgospa_eval.formats.reading import Reading as Reading

_HOME = {
    "ROLES": "options",
    "ReadOptions": "options",
    "Reading": "reading",
    "read": "objects",
    "read_trajectories": "objects",
    "runs_inside": "objects",
}

__getattr__ = lazy(__name__, _HOME)

__all__ = ["FORMATS", *_HOME]
