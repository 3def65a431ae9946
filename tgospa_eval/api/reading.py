"""Reading of truth and estimate: in the same units, clock and frame, and on the same steps."""

import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext, suppress
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any

from tgospa_eval.api.resolve import ResolvedRequest
from tgospa_eval.common.files import STDIN, is_regular
from tgospa_eval.common.frozen import replace
from tgospa_eval.distances.base import check_columns, check_states
from tgospa_eval.errors import ConfigError, InputError, NothingLeftError, TgospaError
from tgospa_eval.evaluation.axis import check_left
from tgospa_eval.evaluation.prepare import AlignedPair, fit
from tgospa_eval.evaluation.request import MOT_METRICS, EvaluationRequest
from tgospa_eval.formats import ROLES, Reading, ReadOptions, objects, read
from tgospa_eval.formats.guess import file_of, folder_format
from tgospa_eval.formats.headers import direction_of
from tgospa_eval.formats.loading import plain_name
from tgospa_eval.formats.reading import (
    by_one_place,
    check_classes,
    check_units,
    in_one_clock,
    in_one_spelling,
    with_heights,
)
from tgospa_eval.formats.rows import NOT_CONSIDERED
from tgospa_eval.quoting import listed, option
from tgospa_eval.tracks.trajectories import HEIGHT

if TYPE_CHECKING:
    from tgospa_eval.formats.objects import Components, TrajectoriesLike


# -------------------------------------------------------------------------------------------------
# Errors about a path that is a folder or a pattern. They list its files and a command to type.

SUFFIXES = (".csv", ".tsv", ".txt", ".parquet", ".pq", ".feather", ".arrow", ".npz", ".mat")
ASIDE = {"det", "img1", "seqmaps"}
"""Names of folders of MOTChallenge that have no tracks."""

DEEP = 4
"""Largest number of parts in the path of a found file: train/MOT17-02/gt/gt.txt has 4 parts."""

MAX_FILES = 10_000
"""Number of files after which a search ends."""

FILES_SHOWN = 3
SHAPES = 20


Place = tuple[str, tuple[str, tuple[str, ...]]]
"""A message about a folder or a pattern; then the folder, and the tables that were found in it."""


CSV = re.compile(r".*\.csv(\.gz|\.zst)?", re.IGNORECASE).fullmatch
"""Test whether a name is that of a CSV file, also a compressed one."""


def check_places(paths: Sequence[str]) -> None:
    """Check that no path is a folder without a known format, or a pattern of files.

    Raises
    ------
    InputError
        A path is such a folder or a pattern. The message has a command to type.
    """
    places = [find_place(path) for path in paths]
    if any(places):
        messages = [
            f"{path}: no such file" if place is None else place[0]
            for path, place in zip(paths, places, strict=True)
            if place is not None or not (path == STDIN or os.path.lexists(file_of(path)))
        ]
        raise InputError(*messages, *_advice(paths, places), *_whole(paths, places))


def find_place(path: str) -> Place | None:
    """Return a message and the files, if a path is a folder or a pattern; else None."""
    if os.path.isdir(path) and not folder_format(path):
        files = tuple(_files(path))
        inside = f"in it: {listed(files, FILES_SHOWN)}" if files else "it has no tables"
        return f"{path}: is a folder, not a file; {inside}", (path, files)
    pattern = re.search(r"[*?[]", path)
    if pattern is None or os.path.lexists(path):
        return None
    import glob  # lazy: few paths are patterns

    folder = os.path.dirname(path[: pattern.start()])
    names = sorted(name for name in glob.glob(path) if os.path.isfile(name))
    if names:
        files = tuple(os.path.relpath(name, folder or ".").replace(os.sep, "/") for name in names)
        message = f"{path}: is a pattern, not a file; it matches {listed(names, FILES_SHOWN)}"
        return message, (folder, files)
    files = tuple(_files(folder or "."))
    inside = (
        f"{folder or 'this folder'} has {listed(files, FILES_SHOWN)}"
        if files
        else "the folder has no tables"
    )
    return f"{path}: no file matches this pattern; {inside}", (folder, files)


def _files(folder: str) -> Iterator[str]:
    """Yield the relative paths of tables below a folder.

    A folder that a reader takes as a whole, like the folders of some formats, counts as one table.
    """
    count = 0
    for parent, folders, files in os.walk(folder):
        inner = os.path.relpath(parent, folder).replace(os.sep, "/")
        depth = 0 if inner == "." else inner.count("/") + 1
        folders[:] = sorted(
            name for name in folders if name not in ASIDE and name[0] != "." and depth + 1 < DEEP
        )
        count += len(files)
        if inner != "." and folder_format(parent):
            folders.clear()
            yield inner
            continue
        for name in sorted(files):
            if plain_name(name).endswith(SUFFIXES):
                yield name if inner == "." else f"{inner}/{name}"
        if count > MAX_FILES:
            return


def _advice(paths: Sequence[str], places: Sequence[Place | None]) -> Iterator[str]:
    """Yield commands to type, which read files with the same name in both places."""
    shapes = [
        _shapes(("", (path,)) if place is None else place[1])
        for path, place in zip(paths, places, strict=True)
    ]
    if len(shapes) == 1:
        first = next((next(iter(files.values())) for files in shapes[0].values()), None)
        if first is not None:
            yield f"for one of them: tgospa-eval inspect {_quoted(first)}"
        return
    if not all(shapes):
        return
    best = max(product(*shapes), key=lambda pair: _fit(shapes, *pair))
    truth, estimate = (by_shape[shape] for by_shape, shape in zip(shapes, best, strict=True))
    names = [name for name in truth if name in estimate and truth[name] != estimate[name]]
    if not names:
        # If each folder has only one file, the two belong together.
        files = [{path for group in one.values() for path in group.values()} for one in shapes]
        if all(len(some) == 1 for some in files) and files[0] != files[1]:
            yield _type(*(some.pop() for some in files))
        elif all(places):
            yield "the folders have no file names in common: name two files"
        return
    name = names[0]
    yield _type(truth[name], estimate[name])
    from tgospa_eval.campaign.pairs import layout_of  # lazy: slow to import, only for errors

    layout = layout_of(*paths) if len(names) > 1 else None
    if layout is not None:
        folders = " ".join(map(_quoted, paths))
        yield f"for all: tgospa-eval batch --layout {layout} {folders} -o results"
    elif len(names) > 1:
        yield from _all(names, *best)


def _whole(paths: Sequence[str], places: Sequence[Place | None]) -> Iterator[str]:
    """Yield the command that reads each of two folders of CSV files as one recording."""
    inside = [
        place[1][1] if place is not None and os.path.isdir(path) else ()
        for path, place in zip(paths, places, strict=True)
    ]
    if len(paths) == len(ROLES) and all(files and all(map(CSV, files)) for files in inside):
        folders = " ".join(map(_quoted, paths))
        yield f"if each folder is one recording: tgospa-eval {folders} --memory 4GB"


def _quoted(path: str) -> str:
    import shlex  # lazy: only for errors

    return shlex.quote(path)


def _type(truth: str, estimate: str) -> str:
    return f"type: tgospa-eval {_quoted(truth)} {_quoted(estimate)}"


def _all(names: list[str], truth: str, estimate: str) -> Iterator[str]:
    """Yield the commands that evaluate all sequences, whose names replace `{}` in both paths."""
    sides = [side.format("{name}") for side in (truth, estimate)]
    options = " ".join(
        f"--{role} {_quoted(side)}" for role, side in zip(("truth", "estimate"), sides, strict=True)
    )
    yield f"for all {len(names)}: tgospa-eval batch {options} -o results"
    yield (
        "or judge all by a baseline: tgospa-eval gate --suite FILE, if FILE has [[pair]] with "
        f'truth = "{sides[0]}" and estimate = "{sides[1]}"'
    )


def _shapes(place: tuple[str, tuple[str, ...]]) -> dict[str, dict[str, str]]:
    """Return the shapes that most files of a place have.

    A shape is a path with `{}` for a name: gt/MOT17-02/gt/gt.txt has the shape gt/{}/gt/gt.txt with
    the name MOT17-02. A path has several shapes. The answer has a dict for each shape, with the
    path of each name.
    """
    folder, files = place
    shapes: dict[str, dict[str, str]] = {}
    for file in files:
        path = os.path.normpath(os.path.join(folder, file)).replace(os.sep, "/")
        parts = path.split("/")
        begin = len(parts) - len(os.path.normpath(file).split(os.sep)) if folder else 0
        for k in range(begin, len(parts)):
            is_file = k == len(parts) - 1 and "." in parts[k]
            stem, dot, suffix = parts[k].rpartition(".") if is_file else (parts[k], "", "")
            if not stem or "{" in path or "}" in path:
                continue
            shape = "/".join((*parts[:k], f"{{}}{dot}{suffix}", *parts[k + 1 :]))
            shapes.setdefault(shape, {})[stem] = path
    largest = sorted(shapes, key=lambda shape: -len(shapes[shape]))[:SHAPES]
    return {shape: shapes[shape] for shape in largest}


def _fit(
    shapes: Sequence[dict[str, dict[str, str]]], truth: str, estimate: str
) -> tuple[int, bool, int]:
    """Return how well the shapes `truth` and `estimate` match; the largest tuple is the best.

    The tuple has the number of common names, whether the path of the truth has a part ``gt``, and a
    number that is larger for shorter shapes.
    """
    common = len(set(shapes[0][truth]) & set(shapes[1][estimate])) if truth != estimate else 0
    return common, "gt" in re.split(r"[/._]", truth), -len(truth) - len(estimate)


def display_names(given: Sequence[object], roles: Sequence[str] = ROLES) -> tuple[str, ...]:
    """Return names for messages: the path of a file, or the role of data in memory."""
    return tuple(
        os.fsdecode(side) if objects.is_path(side) else role
        for side, role in zip(given, roles, strict=False)
    )


def read_pair(
    resolved: ResolvedRequest,
    *given: "TrajectoriesLike | Reading",
    roles: tuple[str, ...] = ROLES,
    names: tuple[str, ...] | None = None,
    mapping: "Components | None" = None,
    advise: bool = True,
    known: dict[str, Reading] | None = None,
) -> tuple[Reading, ...]:
    """Read truth and estimate, or only the truth, or the states of sensors.

    Truth and estimate are converted to the same units, clock and frame. Rows that options exclude
    are left out.

    Parameters
    ----------
    resolved : ResolvedRequest
        How to read.
    *given : path, Trajectories, DataFrame, array, mapping, set of tracks, or Reading
        The sides: truth and estimate, or others according to `roles`.
    roles : tuple of str
        Role of each side, ``"truth"`` or ``"estimate"``. Sensors have the role of an estimate.
    names : tuple of str, optional
        Names of data in memory in messages; by default their roles.
    mapping : sequence of int, or pair of such, optional
        Indices of the state components to compare, as in `evaluate`.
    advise : bool
        Whether errors about a folder or a pattern of files end with a command to type.
    known : dict, optional
        Cache of the truth that was read last; the key is its path. This function updates it. Pass
        the same dict for several estimates to read their truth once.

    Raises
    ------
    InputError
        A path is a folder, a side is wrong, or no side has a header that an option names. The
        message has the errors of all sides.
    ConfigError
        No side has a requested class; or options that select rows leave none, or do not apply to a
        side.
    """
    names = display_names(given, names or roles)
    whole = given
    given = tuple(objects.with_plain_axes(*both) for both in zip(given, names, strict=True))
    if advise:
        check_places(names)
    sides = _read(resolved, given, roles, names, mapping, known)
    sides = tuple(objects.with_units(*both) for both in zip(sides, whole, strict=True))
    if len(sides) == len(ROLES):
        sides = _brought_together(resolved, sides, names, given)
    if resolved.coverage is not None:
        sides = _covered(resolved, sides, names)
    with suppress(NothingLeftError) if resolved.allow_empty else nullcontext():
        check_sides(resolved, sides, names)
    if roles != ROLES or len(sides) < len(ROLES):
        return sides
    sides = _preprocessed(resolved, sides, names)
    ignoring = resolved.evaluation.ignoring
    return sides if ignoring is None else ignoring.mark(sides, names)


def _read(
    resolved: ResolvedRequest,
    given: Sequence["TrajectoriesLike | Reading"],
    roles: tuple[str, ...],
    names: tuple[str, ...],
    mapping: "Components | None",
    known: dict[str, Reading] | None,
) -> tuple[Reading, ...]:
    """Read all sides, and raise the errors of all sides together.

    The states of all sides are made from the same columns of positions, if this is possible.
    Heights are part of the states if both sides have heights. Parameters are those of `read_pair`.
    """
    distance, frames, each = resolved.evaluation.distance, resolved.frames, resolved.each
    paths = tuple(os.fsdecode(side) for side in given if objects.is_path(side))

    def read_side(k: int, chosen: Sequence[int] | None, options: ReadOptions) -> Reading:
        if objects.is_path(given[k]):
            options = options.with_paths(paths, roles)
            options = replace(options, option="columns") if len(paths) == 1 else options
        about = roles[k], resolved.formats[k], names[k]
        return read(given[k], options, *about, columns=distance.columns, mapping=chosen)

    made: list[Reading | None] = []
    again: list[Callable[[ReadOptions], Reading] | None] = []
    faults: list[TgospaError] = []
    for k, (side, chosen) in enumerate(
        zip(given, objects.components_of(given, mapping), strict=False)
    ):
        again.append(partial(read_side, k, chosen) if _stays(side) else None)
        try:
            before = known.get(names[0]) if known and k == 0 else None
            made.append(None if objects.is_empty(side) else before or read_side(k, chosen, each[k]))
        except (InputError, ConfigError) as error:
            faults.append(error)
    if faults:
        raise type(faults[0])(*dict.fromkeys(line for fault in faults for line in fault.args))
    if known is not None and objects.is_path(given[0]) and made[0]:
        known.clear()
        known[names[0]] = made[0]  # the truth, before it is adapted to this estimate
    made = by_one_place(made, each, again)
    if len(made) == len(ROLES):
        local = frames is not None and frames.begin is not None
        made = with_heights(made, each, again, names, local=local, distance=distance.name)
    sides = objects.filled(made, distance.columns)
    objects.check_as_long(given, sides, names)
    return sides


def _brought_together(
    resolved: ResolvedRequest,
    sides: tuple[Reading, ...],
    names: tuple[str, ...],
    given: Sequence[object],
) -> tuple[Reading, ...]:
    """Convert truth and estimate to the same units, clock and frame."""
    for k in range(len(ROLES)):
        sides = _converted(resolved, sides, k, given[k])
    truth, estimate = sides = in_one_clock(sides)
    if resolved.reading.by_class:
        sides = truth, estimate = truth, in_one_spelling(truth, estimate)
    if resolved.frames is not None:
        both = truth.trajectories, estimate.trajectories
        *placed, warning = resolved.frames.joined(both, names)
        warnings = estimate.warnings if warning is None else (*estimate.warnings, warning)
        sides = (
            replace(truth, trajectories=placed[0]),
            replace(estimate, trajectories=placed[1], warnings=warnings),
        )
    return sides


def _stays(side: object) -> bool:
    """Return whether a side can be read a second time, unlike a pipe or a `Reading`."""
    if isinstance(side, Reading):
        return False
    return not objects.is_path(side) or not os.path.exists(side) or is_regular(os.fsdecode(side))


def _converted(
    resolved: ResolvedRequest, sides: tuple[Reading, ...], k: int, given: object
) -> tuple[Reading, ...]:
    """Convert side `k` to the requested times and units, unless its reader did this.

    Return both sides.
    """
    conversion, role, own = resolved.conversions[k], ROLES[k], resolved.each[k]
    if not conversion.recorded_of(role):
        return sides
    if own.conversion.recorded_of(role) and objects.has_rows(given, own):
        return sides
    if conversion.unit_scale != 1:
        truth, estimate = (side.trajectories for side in sides)
        check_columns(truth, estimate)
        check_states(truth, estimate, resolved.evaluation.distance)
        distance = resolved.measure.distance(truth.columns).settings(truth.columns)
        conversion = replace(conversion, angles=tuple(distance.get("periodic", ())))
    made = conversion(sides[k].trajectories, role)
    return (*sides[:k], replace(sides[k], trajectories=made), *sides[k + 1 :])


def _covered(
    resolved: ResolvedRequest, sides: tuple[Reading, ...], names: tuple[str, ...]
) -> tuple[Reading, ...]:
    """Return all sides with only the rows inside the circle or the regions of ``--region``."""
    from tgospa_eval.evaluation.preprocess import kept_rows  # lazy: few evaluations have regions
    from tgospa_eval.evaluation.regions import coverage, inside

    assert resolved.coverage is not None
    kept, origin = [], None if resolved.frames is None else resolved.frames.begin
    for side, name in zip(sides, names, strict=True):
        earth = origin is not None or "lat" in side.trajectories.columns
        regions = coverage(resolved.coverage, resolved.reading.decimal, earth=earth)
        near = resolved.evaluation.time_matching.near
        rows = inside(replace(regions, origin=origin), side.trajectories, near, name)
        kept.append(kept_rows(side, rows, "region"))
    return tuple(kept)


def _preprocessed(
    resolved: ResolvedRequest, sides: tuple[Reading, ...], paths: tuple[str, ...]
) -> tuple[Reading, ...]:
    """Return both sides, without the rows that the benchmark of ``--preprocess`` leaves out.

    Without ``--preprocess``, no rows are left out. If a metric of MOTChallenge is requested, the
    truth gets a warning about rows that MOTChallenge leaves out.

    Raises
    ------
    ConfigError
        The truth lacks the columns that the rules need.
    """
    with_ = {*resolved.evaluation.with_}
    if not resolved.preprocess and (not resolved.measure.boxes or with_.isdisjoint(MOT_METRICS)):
        return sides
    from tgospa_eval.evaluation.preprocess import (  # lazy: only for boxes
        benchmark_warnings,
        preprocessed,
    )

    of_truth = resolved.each[0]

    def everything(**changes: Any) -> Reading:
        """Read all rows of the truth: of all classes, and rows with a flag to ignore them, too."""
        options = replace(of_truth, classes=None, kept=(NOT_CONSIDERED,), **changes)
        return read(paths[0], options, "truth", resolved.formats[0])

    if resolved.preprocess:
        ignoring = resolved.evaluation.ignoring
        return preprocessed(
            resolved.preprocess,
            sides,
            lambda: everything(attributes=(*of_truth.attributes, "conf")),
            (paths[0], paths[1]),
            None if ignoring is None else ignoring.regions,
        )
    warnings = benchmark_warnings(sides[0], lambda: everything(attributes=("class",)))
    return replace(sides[0], warnings=(*sides[0].warnings, *warnings)), *sides[1:]


def check_sides(
    resolved: ResolvedRequest, sides: tuple[Reading, ...], paths: tuple[str, ...]
) -> None:
    """Check that at least one side has the requested headers and classes.

    Raises
    ------
    InputError
        No side has a header that an option names, or a column of classes.
    ConfigError
        No side has a requested class, or options that select rows leave none.
    """
    for name in sides[0].missing:
        if all(name in side.missing for side in sides):
            raise InputError(*dict.fromkeys(side.missing[name] for side in sides))
    upward = [direction_of(side.headers.get("z", "")) for side in sides]
    if resolved.frames is None and {"up", "down"} <= {*upward}:
        ways = " and ".join(option(f"{role}_crs", "enu") for role in ROLES)
        raise InputError(
            f"z is {upward[0]} in {paths[0]}, and {upward[1]} in {paths[1]}; use {ways} (enu: x "
            "east, y north, z up), with ned for a file whose x is north"
        )
    scales = [(one.unit_scale != 1, dict(one.scale)) for one in resolved.conversions]
    frames, distance = resolved.frames, resolved.evaluation.distance
    for side, path in zip(sides, paths, strict=True):
        if HEIGHT in side.trajectories.columns:  # before their units are checked
            distance.check_columns(side.trajectories.columns, path)
    earth = [option("distance", distance.name)] * 2 * distance.on_earth
    axes = earth if frames is None else [f"{one.option} {one.text}" for one in frames.frames]
    metric = frames is None or frames.origin is not None or False in frames.is_local
    check_units(
        sides,
        paths,
        lambda k, name: scales[k][0] or name in scales[k][1],
        metres=axes if metric else earth,
        degrees=axes,
    )
    check_classes(sides, paths, resolved.reading.classes, resolved.each)
    filters = {"time", "class", "region", "where"}
    if not any(side.taken for side in sides) and any(
        filters & side.left_out.keys() for side in sides
    ):
        used = (name for name in resolved.recorded if name.split("_")[-1] in filters)
        given = " and ".join(option("class_" if name == "class" else name) for name in used)
        raise NothingLeftError(f"{given}: no row is left to evaluate")


def align_sides(
    resolved: ResolvedRequest, sides: tuple[Reading, ...], names: tuple[str, ...]
) -> tuple[AlignedPair, EvaluationRequest]:
    """Bring two sides to the same steps. Also return the request, with the complete distance.

    Raises
    ------
    ConfigError
        An option does not fit the sides.
    InputError
        The two sides do not fit each other.
    """
    truth, estimate = (side.trajectories for side in sides)
    check_columns(truth, estimate, (names[0], names[1]))
    request = resolved.request(truth.columns)
    fitted = fit(truth, estimate, request, (names[0], names[1]))
    if not resolved.allow_empty:
        kept = sum(len(side.step) for side in fitted.axis.sides)
        check_left(request.time_matching, kept, fitted.axis.left_out)
    same = [
        option(f"{role}_columns", f"t={other.headers['t']}")
        for role, side, other in zip(ROLES, sides, sides[::-1], strict=True)
        if other.headers.get("t") in side.unused
    ]
    return replace(fitted, headers=sides[1].headers, same_header=next(iter(same), "")), request
