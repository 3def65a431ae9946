"""Roles of the headers that were met: the files of a study have the same."""

from collections.abc import Callable, Sequence
from dataclasses import fields
from operator import attrgetter

from tgospa_eval.formats.columns.roles import Roles, find_roles
from tgospa_eval.formats.options import ReadOptions

MOST_HEADERS = 64

_OPTIONS: Callable[[ReadOptions], tuple[object, ...]] = attrgetter(
    *(field.name for field in fields(ReadOptions) if field.name != "beside")
)
"""What roles may depend on: all options but the names of the files."""

_known: dict[tuple[tuple[str, ...], tuple[object, ...]], Roles] = {}


def known_roles(
    header: Sequence[str], options: ReadOptions, where: str, sample: Sequence[str]
) -> Roles:
    """`find_roles`, of the same header with the same options only once.

    Raises
    ------
    InputError, ConfigError
        As `find_roles`.
    """
    key = tuple(header), _OPTIONS(options)
    if key not in _known:
        roles = find_roles(header, options, where, sample=sample)
        if roles.lacking or roles.passed:  # sentences that name the file
            return roles
        if len(_known) >= MOST_HEADERS:
            _known.clear()
        _known[key] = roles
    return _known[key]
