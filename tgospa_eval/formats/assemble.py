"""Rows of a file to Trajectories: what is left out, duplicates, order."""

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from tgospa_eval.common.notices import Notice
from tgospa_eval.common.words import counted
from tgospa_eval.errors import InputError
from tgospa_eval.formats.filters import Flags
from tgospa_eval.formats.options import ReadOptions
from tgospa_eval.formats.reading import Reading
from tgospa_eval.formats.rows import Rows
from tgospa_eval.formats.times import more
from tgospa_eval.text import quoted
from tgospa_eval.tracks.trajectories import Floats, Ints, Trajectories

if TYPE_CHECKING:
    from tgospa_eval.formats.columns.spread import Spread


def assemble(rows: Rows, options: ReadOptions, format: str) -> Reading:
    """Trajectories of the rows that take part, with counts of the others.

    A row counts under the first rule that leaves it out. Steps of the file stay steps, even where
    nothing is left, but for those outside the range of time.

    Raises
    ------
    InputError
        An (id, t) is repeated and `on_duplicate` is ``"error"``, or a box has no size.
    """
    roles, times = rows.roles, rows.times
    state = roles.mixed(rows.numbers, roles.state)
    moments, step = _number_times(times.value)
    labels = None
    if times.text is not None:
        labels = np.empty(len(moments), dtype=object)
        labels[step[::-1]] = np.array([text.strip() for text in times.text], dtype=object)[::-1]
    chosen = _Choice(len(state))
    for rule, (apart, sentence) in rows.apart.items():
        chosen.keep(~apart, rule, sentence)
    filled = np.ones(len(state), bool)
    for column in state.T:
        filled &= column == column  # NaN is not
    chosen.keep(filled, "blank", "with a blank or NaN position: absent at that step")
    if options.moments is not None:
        inside = options.moments.inside(moments, times.clock, rows.name)
        chosen.keep(inside[step], "time", "left out by --time")
        moments, labels = moments[inside], None if labels is None else labels[inside]
        step = (np.cumsum(inside) - 1)[step]
    if options.classes is not None and rows.classes is not None:
        names = {name.strip() for name in options.classes}
        known = np.array([name in names for name in rows.classes[0]], bool)
        chosen.keep(known[rows.classes[1]], "class", "left out by --class")
        for name in sorted(names - set(rows.classes[0])):
            there = ", ".join(map(quoted, rows.classes[0][:10])) or "none"
            chosen.notices.append(f"no row of class {quoted(name)}; there are {there}")
    elif options.classes is not None:
        chosen.notices.append("no column class: --class leaves all its rows in")
    track_ids, track = rows.ids
    key = step.astype(np.int64) * max(len(track_ids), 1) + track
    particles = None
    if roles.weight is not None:
        from tgospa_eval.formats.particles import gather  # here, as below: most states are points

        particles = gather(rows, key, chosen.mask, always=options.clouds and roles.spread is None)
    if roles.region:
        values = roles.mixed(rows.numbers, tuple(roles.region.values()))
        if particles is not None:  # a cloud is where its mean is
            values = particles.means(values)
        inside = np.ones(len(state), bool)
        for column, (low, high) in zip(values.T, options.ranges.values(), strict=True):
            inside &= (column >= low) & (column <= high)
        chosen.keep(inside, "region", "left out by --region")
    _check_states(rows, state, chosen.mask, options)

    taken, ordered = _by_key(key, None if chosen.all() else np.flatnonzero(chosen.mask))
    again = np.flatnonzero(ordered[1:] == ordered[:-1])
    clouds = None
    warnings: list[Notice] = []
    if particles is not None:
        clouds, taken, ordered = particles.clouds(rows, state, taken, ordered)
        chosen.notices += particles.notices(clouds, compared=options.clouds)
    elif len(again):
        from tgospa_eval.formats.repeats import most_repeat, refusal  # here: few files have any

        if options.on_duplicate == "error":
            raise InputError(refusal(taken, again, key, rows, format))
        warnings += most_repeat(taken, again, rows, options.on_duplicate)
        drop = again + 1 if options.on_duplicate == "first" else again
        taken, ordered = np.delete(taken, drop), np.delete(ordered, drop)
        rows_repeat = counted(len(again), "row repeats", "rows repeat")
        chosen.notices.append(f"{rows_repeat} an (id, t): the {options.on_duplicate} one was taken")
        chosen.left_out["duplicate"] = len(again)

    # From the sorted keys: cheaper than gathering two columns from all over the table.
    step_used, track_used = np.divmod(ordered, max(len(track_ids), 1))
    has_rows = np.bincount(track_used, minlength=len(track_ids)) > 0
    used = np.flatnonzero(has_rows)
    if len(used) < len(track_ids):
        track_used = (np.cumsum(has_rows) - 1)[track_used]
    notices = chosen.notices
    covariance: Floats | None = None
    if roles.spread is not None and clouds is None:
        covariance, said = _covariances(rows, taken, roles.spread, options)
        warnings += [notice for notice in said if notice.code]
        notices += [notice.text for notice in said if not notice.code]
    trajectories = Trajectories(
        step=step_used,
        track=track_used,
        state=state.take(taken, axis=0) if clouds is None else clouds.means,
        clouds=clouds,
        ids=track_ids[used],
        times=cast(NDArray[np.float64], moments),
        columns=roles.names,
        clock=times.clock,
        labels=labels,
        covariance=covariance,
    )
    classes, klass = (), None
    if options.by_class and rows.classes is not None:
        number = rows.classes[1][taken]
        present = np.flatnonzero(np.bincount(number, minlength=len(rows.classes[0])))
        classes, klass = tuple(rows.classes[0][present]), np.searchsorted(present, number)
        if "" in classes:
            count = int(np.count_nonzero(klass == classes.index("")))
            rows_have = counted(count, "row has", "rows have")
            chosen.notices.append(f'{rows_have} no class: evaluated as a class named ""')
    if roles.centres:
        notices = ["boxes are compared by their centres (x, y); overlap: --distance iou", *notices]
    notices = [*roles.notices(clouds=clouds is not None), *notices]
    return Reading(
        trajectories=trajectories,
        rows=len(state),
        notices=tuple(notices),
        warnings=tuple(warnings),
        left_out=chosen.left_out,
        format=format,
        classes=classes,
        klass=klass,
        named=() if rows.classes is None else tuple(rows.classes[0]),
        lacking=roles.lacking,
        headers=roles.called,
        pixels=roles.centres and roles.fixed,
    )


class _Choice:
    """Rows that still take part, and what became of the others."""

    def __init__(self, rows: int) -> None:
        self.mask = np.ones(rows, bool)
        self.left_out: dict[str, int] = {}
        self.notices: list[str] = []

    def keep(self, inside: Flags, rule: str, sentence: str) -> None:
        """Leave out what is not inside."""
        before = int(np.count_nonzero(self.mask))
        self.mask &= inside
        count = before - int(np.count_nonzero(self.mask))
        if count:
            self.left_out[rule] = count
            self.notices.append(f"{counted(count, 'row')} {sentence}")

    def all(self) -> bool:
        """Whether nothing was left out."""
        return not self.left_out


def _check_states(rows: Rows, state: Floats, mask: Flags, options: ReadOptions) -> None:
    """Sizes of boxes, sums that are no doubles, and what the distance cannot compare."""
    if rows.roles.centres or options.boxes:
        wrong = np.flatnonzero(mask & ~np.isfinite(state).all(axis=1))
        if len(wrong):
            raise InputError(
                f"{rows.where(int(wrong[0]))}: a box too large for a number{more(len(wrong))}; "
                "use another unit"
            )
    for name, size in zip(("width", "height"), rows.roles.sizes, strict=False):
        extent = rows.roles.mixed(rows.numbers, (size,))[:, 0]
        wrong = np.flatnonzero(mask & ~(extent > 0 if options.boxes else extent >= 0))
        if len(wrong):
            rule = "it must be > 0 for --distance iou" if options.boxes else "it must be >= 0"
            raise InputError(
                f"{rows.where(int(wrong[0]))}, column {quoted(name)}: {extent[wrong[0]]:g} is no "
                f"{name} of a box{more(len(wrong))}; {rule}"
            )
    chosen = np.flatnonzero(mask)
    fault = options.fault(rows.roles.names, state[chosen].T) if options.fault else None
    if fault is not None:
        row, name, what = fault
        raise InputError(f"{rows.where(int(chosen[row]))}, column {quoted(name)}: {what}")


def _covariances(
    rows: Rows, taken: Ints, spread: "Spread", options: ReadOptions
) -> tuple[Floats, list[Notice]]:
    """The covariances of some rows, and what to say of them."""
    from tgospa_eval.formats.columns.spread import Cells, covariances_of

    numbers = rows.roles.numbers
    cells = Cells(
        values={column: rows.numbers[taken, numbers.index(column)] for column in spread.columns},
        row=taken,
        where=lambda row: f"{rows.where(row)} (id {rows.called(row)}, t {rows.moment(row)})",
    )
    return covariances_of(
        cells, spread, missing=options.missing_covariance, fix=options.fix_covariance
    )


def _by_key(key: Ints, chosen: Ints | None) -> tuple[Ints, Ints]:
    """Rows, all or the chosen, in the order of their keys, and the sorted keys."""
    if chosen is not None:
        key = key[chosen]
    if len(key) and key.max() < 4 * len(key):  # nearly a full grid: a table is quicker than sorting
        table = np.full(int(key.max()) + 1, -1)
        table[key] = np.arange(len(key))
        ordered = np.flatnonzero(table >= 0)
        if len(ordered) == len(key):
            rows = table[ordered]
            return (rows if chosen is None else chosen[rows]), ordered
    rows = np.argsort(key, kind="stable")
    return (rows if chosen is None else chosen[rows]), key[rows]


def _number_times(value: NDArray[Any]) -> tuple[NDArray[Any], Ints]:
    """Distinct times in order, and the number of each row's."""
    if value.dtype.kind == "i" and len(value):
        low, high = int(value.min()), int(value.max())
        if high - low < 4 * len(value):  # a table is quicker than sorting
            seen = np.zeros(high - low + 1, bool)
            seen[value - low] = True
            return np.flatnonzero(seen) + low, (np.cumsum(seen) - 1)[value - low]
    moments, step = np.unique(value, return_inverse=True)
    return moments, step
