"""Registries: objects of one kind by name, such as base distances or file formats.

The objects are called members. They belong to this package, or to other packages, which declare
them as entry points. A registry imports nothing slow, because the command line needs the names for
its help.
"""

import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from operator import attrgetter
from typing import Any, Generic, NamedTuple, TypeVar

from tgospa_eval.errors import ConfigError, TgospaError
from tgospa_eval.quoting import quoted

T = TypeVar("T")


class EntryPoint(NamedTuple):
    """One line of the ``entry_points.txt`` of an installed package."""

    package: str
    group: str
    name: str
    place: str

    def __str__(self) -> str:
        return f"the package {self.package} (entry point {self.name} = {self.place})"


class Registry(Mapping[str, T], Generic[T]):
    """Mapping from names to members. A member is imported when it is used.

    Parameters
    ----------
    kind : str
        Noun for a member in messages.
    group : str
        Group of the entry points of other packages.
    own : dict of str to str
        Place of each member of this package, written as in an entry point: ``"module:attribute"``.
    make : callable
        Function that receives the name and the imported attribute, and returns the member.
    """

    def __init__(
        self, kind: str, group: str, own: dict[str, str], make: Callable[[str, Any], T]
    ) -> None:
        self.kind, self.group, self.own, self._make = kind, group, own, make

    @property
    def outside(self) -> dict[str, list[EntryPoint]]:
        """Entry points of other packages by name; several packages can declare the same name."""
        members: dict[str, list[EntryPoint]] = {}
        for point in _entry_points(tuple(sys.path)):
            if point.group == self.group:
                members.setdefault(point.name, []).append(point)
        return members

    def __iter__(self) -> Iterator[str]:
        return iter(self.own | self.outside)

    def __len__(self) -> int:
        return len(self.own | self.outside)

    def __contains__(self, name: object) -> bool:
        return name in self.own or name in self.outside

    def __getitem__(self, name: str) -> T:
        points = self.outside.get(name, [])
        owners = ["tgospa-eval"] * (name in self.own) + list(map(str, points))
        if len(owners) > 1:
            raise ConfigError(
                f"the {self.kind} {quoted(name)} is provided by {' and by '.join(owners)}: rename "
                "the entry point, or uninstall a package"
            )
        if not points:
            return self.ours(name)
        with self.blamed(name):
            return self._load(name, points[0].place)

    def ours(self, name: str) -> T:
        """Return a member of this package, even if another package declares the same name."""
        return self._load(name, self.own[name])

    def chosen(self, name: object) -> T:
        """Return the member with a name that the user gave.

        Raises
        ------
        ConfigError
            No member or several members have this name, or the import of the member fails.
        """
        if not isinstance(name, str) or name not in self:
            raise ConfigError(f"no {self.kind} {quoted(name)}; there are {', '.join(self)}")
        return self[name]

    @contextmanager
    def blamed(
        self, name: str, error: type[TgospaError] = ConfigError, where: str = ""
    ) -> Iterator[None]:
        """Turn an error of the member `name` in the block into one that names its package.

        Three kinds of errors do not change: those of members of this package, `TgospaError` and
        `MemoryError`. `error` is the class of the new error, and `where` begins its message.
        """
        try:
            yield
        except (TgospaError, MemoryError):
            raise
        except (Exception, SystemExit) as fault:
            if name in self.own or name not in self.outside:
                raise
            raise error(
                f"{where}the {self.kind} {quoted(name)} of {self.outside[name][0]} does not work: "
                f"{type(fault).__name__}: {fault}"
            ) from fault

    def _load(self, name: str, place: str) -> T:
        return self._make(name, load(place))


def load(place: str) -> Any:
    """Import and return the object at ``"module:attribute"``, or the module at ``"module"``."""
    module, _, attribute = place.partition(":")
    value: Any = import_module(module)
    return attrgetter(attribute)(value) if attribute else value


def lazy(package: str, home: Mapping[str, str]) -> Callable[[str], Any]:
    """Return a ``__getattr__`` for a package. It imports a public name at the first use.

    `home` has the module of each public name, relative to the package.
    """

    def get(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(f"{package}.{home[name]}"), name)
        setattr(sys.modules[package], name, value)
        return value

    return get


@cache
def _entry_points(folders: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """Return the entry points of all packages that are installed in these folders.

    importlib.metadata is not used, because it would take a third of the time of ``--help``.
    """
    packages: dict[str, list[EntryPoint]] = {}
    for folder in folders:
        with suppress(OSError):
            for item in sorted(os.listdir(folder or ".")):
                if item.endswith((".dist-info", ".egg-info")):
                    package = item.rpartition(".")[0].partition("-")[0].replace("_", "-")
                    if package not in packages:  # Python imports only the first one
                        file = os.path.join(folder, item, "entry_points.txt")
                        packages[package] = list(_declared(package, file))
    return tuple(point for points in packages.values() for point in points)


def _declared(package: str, path: str) -> Iterator[EntryPoint]:
    try:
        with open(path, "rb") as file:
            text = file.read()
    except OSError:
        return
    if b"[tgospa_eval." not in text:
        return
    group = ""
    for line in text.decode("utf-8", "replace").splitlines():
        name, mark, place = (part.strip() for part in line.partition("="))
        if name.startswith("["):
            group = name.strip("[]")
        elif mark and name[:1] not in "#;":
            yield EntryPoint(package, group, name, place.partition("[")[0].rstrip())
