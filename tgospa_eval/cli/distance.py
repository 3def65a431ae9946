"""From the options to a base distance."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tgospa_eval.cli.particles import cloud_distance, given_particles
from tgospa_eval.distances import DISTANCES, CloudWasserstein, Distance, Mahalanobis, Norm
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats.columns import BOX, parse_columns

DELIMITERS = ";\t,"


class DistanceOptions:
    """The options of a distance, checked as far as they can be without the columns of the files.

    Parameters
    ----------
    options : dict
        Values of the options of the command line.

    Raises
    ------
    ConfigError
        An option is not understood, or not one of the distance.
    InputError
        The covariance file is missing or wrong.
    """

    def __init__(self, options: dict[str, Any]) -> None:
        self.named = DISTANCES[options["distance"]]
        self.period = _numbers("periodic", options["periodic"], 2 * math.pi)
        self.scale = _numbers("scale", options["scale"])
        self.matrix: list[list[float]] | None = None
        self.path = options["covariance"]
        self.boxes = self.named.columns == BOX
        of_norms = isinstance(self.named, Norm)
        of_matrix = isinstance(self.named, Mahalanobis)
        of_clouds = isinstance(self.named, CloudWasserstein)
        for name, given, allowed, whose in (
            ("periodic", self.period, of_norms, "euclidean, manhattan and chebyshev"),
            (
                "scale",
                self.scale,
                of_norms or of_matrix or of_clouds,
                "the norms, mahalanobis and cloud-wasserstein",
            ),
            ("covariance", self.path, of_matrix, "mahalanobis"),
            *((name, True, of_clouds, "cloud-wasserstein") for name in given_particles(options)),
        ):
            if given and not allowed:
                raise ConfigError(f"--{name} is for {whose}, not for {self.named.name}")
        if of_matrix:
            if not self.path:
                raise ConfigError("--distance mahalanobis needs --covariance FILE")
            self.matrix = read_matrix(self.path, options["decimal"])
            try:
                Mahalanobis(covariance=self.matrix)
            except ConfigError as error:
                raise InputError(f"{self.path}: {error}") from None

        if of_clouds:
            self.named = cloud_distance(options, read_matrix)

    def columns(self, asked: Sequence[str] | None) -> tuple[str, ...] | None:
        """State columns to read: those asked for, else those that the distance needs."""
        needed = None if self.boxes else self.named.columns
        if needed is None or parse_columns(asked)[1]:
            return None if asked is None else tuple(asked)
        return (*(asked or ()), *needed)

    def distance(self, columns: tuple[str, ...]) -> Distance:
        """The distance of states with these columns.

        Raises
        ------
        ConfigError
            An option names a column that does not enter the distance.
        """
        period = _by_column("periodic", self.period, columns, math.inf)
        scale = _by_column("scale", self.scale, columns, 1.0)
        if isinstance(self.named, Norm):
            return Norm(name=self.named.name, power=self.named.power, period=period, scale=scale)
        if isinstance(self.named, CloudWasserstein):
            return replace(self.named, scale=scale)
        if isinstance(self.named, Mahalanobis):
            return Mahalanobis(covariance=self.matrix, scale=scale)
        return self.named


def notices(distance: Distance, columns: tuple[str, ...], cutoff: float) -> list[str]:
    """What the user should know about the choice."""
    found = []
    if isinstance(distance, Norm) and columns == ("lat", "lon"):
        found.append(
            "lat and lon are compared as plain numbers: c, gamma and errors are in degrees; "
            "--distance haversine gives metres"
        )
    if distance.name == "iou" and cutoff > 1:
        found.append(
            f"cutoff {cutoff:g} is above 1, the largest distance of boxes: all pairs of a step "
            "count as near, also those that share nothing; time and memory grow with all pairs"
        )
    return found


def _numbers(option: str, items: Sequence[str], default: float | None = None) -> dict[str, float]:
    """Numbers by name of ``name=number,name=number``."""
    found: dict[str, float] = {}
    for item in (part.strip() for text in items for part in str(text).split(",")):
        name, equals, text = (part.strip() for part in item.partition("="))
        try:
            number = default if default is not None and not equals else float(text)
        except ValueError:
            number = math.nan
        if not name or not 0 < number < math.inf:
            form = "name=number" if default is None else "name or name=number"
            raise ConfigError(f'--{option} "{item}": must be {form}, with a number > 0')
        if name in found:
            raise ConfigError(f'--{option}: "{name}" is given twice')
        found[name] = number
    return found


def _by_column(
    option: str, numbers: dict[str, float], columns: tuple[str, ...], other: float
) -> tuple[float, ...] | None:
    """One number for each column, None if none is given."""
    if not numbers:
        return None
    unknown = [name for name in numbers if name not in columns]
    if unknown:
        raise ConfigError(
            f'--{option}: "{unknown[0]}" is none of the state columns {",".join(columns)}; '
            "choose them with --columns"
        )
    return tuple(numbers.get(name, other) for name in columns)


def read_matrix(path: str, decimal: str) -> list[list[float]]:
    """Read a square matrix: CSV without header, delimited by comma, semicolon or tab.

    Raises
    ------
    InputError
        The file is missing or unreadable, a field is no number, the matrix is not square.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not UTF-8 text; a CSV file is needed") from None
    except (OSError, ValueError) as error:
        what = "is a folder, not a file" if Path(path).is_dir() else "cannot be read"
        reason = "" if Path(path).is_dir() else f": {getattr(error, 'strerror', error)}"
        raise InputError(f"{path}: {what}{reason}") from None
    delimiter = next((mark for mark in DELIMITERS if mark in text and mark != decimal), ";")
    lines = [(k, line) for k, line in enumerate(text.splitlines(), start=1) if line.strip()]
    if not lines:
        raise InputError(f"{path}: the file is empty; a matrix d x d is needed, without header")
    matrix: list[list[float]] = []
    for number, line in lines:
        fields = line.split(delimiter)
        if len(fields) != len(lines):
            raise InputError(
                f"{path}, line {number}: {len(fields)} fields in a file of {len(lines)} rows; "
                "a matrix d x d is needed, without header"
            )
        matrix.append([])
        for column, field in enumerate(fields, start=1):
            try:
                matrix[-1].append(float(field.strip().replace(decimal, ".")))
            except ValueError:
                raise InputError(
                    f'{path}, line {number}, column {column}: not a number: "{field.strip()}"; '
                    "a matrix of numbers is needed, without header"
                ) from None
    return matrix
