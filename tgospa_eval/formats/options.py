"""How to read a file, and which rows of it. Knows no format."""

from collections.abc import Callable, Iterator
from dataclasses import field

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats.filters import Flags, Moments, parse_moments, parse_region
from tgospa_eval.text import quoted
from tgospa_eval.tracks.conversion import Conversion
from tgospa_eval.tracks.trajectories import Floats

ROLES = ("truth", "estimate")
"""What a file may be."""


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """How to read a file, and which rows of it.

    Parameters
    ----------
    columns : tuple of str, optional
        State columns in order; an item ``"name=header"`` has the header of a name
        (``"id=trk"``, ``"t=clock"``, ``"x=px"``). By default x, y, z as far as present, else
        lat, lon, else the centres of boxes.
    decimal : {".", ","}
        Decimal mark.
    on_duplicate : {"error", "first", "last"}
        What to do with a repeated (id, t).
    on_invalid : {"error", "drop"}
        What to do with a row whose state is none: a box without a size, a place that the distance
        does not know.
    boxes : bool
        The states are the boxes themselves, left, top, width, height.
    time : str, optional
        ``"A:B"``: steps from A to B, both included; either end may be blank.
    classes : tuple of str, optional
        Rows of these classes.
    region : str, optional
        ``"x=-50:50,y=0:100"``: rows inside these ranges, ends included; either end may be blank.
    by_class : bool
        The reading has the class of each row.
    class_for : str
        The option that `by_class` is of, for messages.
    covariance : bool
        Read covariances, if there are columns of such.
    fix_covariance : bool
        Replace what is no covariance by the nearest matrix that is.
    missing_covariance : {"error", "zero"}
        What a row with blank covariance is, where there are columns: wrong, or a point.
    clouds : bool
        A column of weights makes rows particles, also where no (id, t) is repeated.
    fault : callable, optional
        Of names of state columns and states (d, R): which are out of range in a column, the column,
        and what is wrong with the first.
    attributes : tuple of str
        Further columns to read, as far as the file has them: see `Trajectories.attributes`.
    conversion : Conversion
        From the stamps and states of the file to those that take part; `time` and `region` are in
        the units of these.
    max_input : float, optional
        GB of memory that reading may take, 0 for any; by default 4, or what is available.
    shared : tuple of str
        Names in `columns`, or ``"class"``, that were given for several files: where one lacks the
        header, it is read by the usual names, and without a filter by class.
    beside : tuple of str
        Paths of the files of the same evaluation: one may have what another needs.
    roles : tuple of str
        What these files are.
    option : str
        What messages call `columns`, see `formats.columns.asked.ask`.

    Raises
    ------
    ConfigError
        A value is none of these.
    """

    columns: tuple[str, ...] | None = None
    decimal: str = "."
    on_duplicate: str = "error"
    on_invalid: str = "error"
    boxes: bool = False
    time: str | None = None
    classes: tuple[str, ...] | None = None
    region: str | None = None
    by_class: bool = False
    class_for: str = "--by class"
    covariance: bool = False
    fix_covariance: bool = False
    missing_covariance: str = "error"
    clouds: bool = False
    fault: Callable[[tuple[str, ...], Floats], tuple[Flags, str, str] | None] | None = None
    attributes: tuple[str, ...] = ()
    conversion: Conversion = field(default_factory=Conversion)
    max_input: float | None = None
    shared: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    roles: tuple[str, ...] = ROLES
    option: str = "columns"

    def __post_init__(self) -> None:
        for name in ("columns", "classes", "attributes"):
            if isinstance(getattr(self, name), str):
                raise ConfigError(f"{name} is {getattr(self, name)!r}: must be a tuple of names")
        for name, allowed in (
            ("decimal", (".", ",")),
            ("on_duplicate", ("error", "first", "last")),
            ("on_invalid", ("error", "drop")),
            ("missing_covariance", ("error", "zero")),
        ):
            one_of(name.replace("_", "-"), getattr(self, name), allowed)
        if self.classes is not None and not all(name.strip() for name in self.classes):
            raise ConfigError("class: a name is blank; name classes, --class car,van")
        parse_moments(self.time)
        parse_region(self.region)

    def beside_others(
        self, paths: tuple[str, ...], roles: tuple[str, ...] = ROLES
    ) -> "ReadOptions":
        """The same for a file that is read with these; what was checked is not checked again."""
        same = object.__new__(ReadOptions)
        vars(same).update(vars(self), beside=paths, roles=roles)
        return same

    @property
    def moments(self) -> Moments | None:
        """`time`, understood."""
        return parse_moments(self.time)

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """`region`, understood."""
        return parse_region(self.region)

    def filters(self) -> Iterator[tuple[str, str | list[str]]]:
        """The filters in use, by the names of their options."""
        for name, value in (("time", self.time), ("class", self.classes), ("region", self.region)):
            if value is not None:
                yield name, list(value) if isinstance(value, tuple) else value
        if self.by_class:
            yield "by", "class"

    def covariances(self) -> Iterator[tuple[str, bool | str]]:
        """What is done about covariances, by the names of the options."""
        if self.covariance:
            yield "fix_cov", self.fix_covariance
            yield "missing_cov", self.missing_covariance


def one_of(name: str, value: object, allowed: tuple[str, ...]) -> None:
    """Whether a value is one of those allowed.

    Raises
    ------
    ConfigError
        The value is not among those allowed.
    """
    if value not in allowed:
        options = ", ".join(f'"{item}"' for item in allowed)
        raise ConfigError(f"{name} is {quoted(value)}: must be one of {options}")
