"""Pairs to evaluate: from patterns, a manifest, the layout of a benchmark, or data in memory.

A pattern is a path with fields in braces, such as ``{tracker}/{sequence}.txt``. This module works
with paths and labels. It reads no trajectories. If a file has several runs, it reads their names.
"""

import glob
import itertools
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Any

from tgospa_eval.common import patterns
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted, natural, parsed_whole
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats import runs_inside
from tgospa_eval.formats.guess import file_of, folder_format
from tgospa_eval.formats.loading import load
from tgospa_eval.formats.objects import is_path, runs_of
from tgospa_eval.formats.text.lines import decode
from tgospa_eval.formats.text.small import rows_of
from tgospa_eval.quoting import listed, option, quoted
from tgospa_eval.tracks.conversion import MAX_STEPS

LAYOUTS = {
    "motchallenge": ("{sequence}/gt/gt.txt", "{tracker}/data/{sequence}.txt"),
    "kitti": ("label_02/{sequence}.txt", "{tracker}/data/{sequence}.txt"),
}
"""Patterns of truth and estimates in the folders of a benchmark, as in TrackEval."""

SEQINFO, SEQMAP = "seqinfo.ini", "evaluate_tracking.seqmap"
DECLARED_IN = {"motchallenge": f"{SEQINFO} with seqLength", "kitti": f"frames in {SEQMAP}.training"}
"""Files that declare the length of a sequence, by benchmark."""

PATHS = ("truth", "estimate")
"""Columns of a manifest with the paths of a pair."""

LARGEST_MANIFEST = 1 << 32
"""Upper limit of the size of a manifest, in bytes."""

NEARBY_LEVELS = 2
"""Number of levels above and below a wrong folder in which the right folder is searched."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """One evaluation: a pair of truth and estimate, its labels and its options.

    Parameters
    ----------
    labels : mapping of str to str
        Values of the labels, by name. They tell this job from others.
    truth, estimate : str
        Paths of truth and estimate.
    options : mapping
        Options of this job, by their names on the command line.
    frames : pair of int, optional
        First and last frame of the sequence, if its benchmark declares them.
    name : str
        Name of the job in the baseline of a gate.
    rules : dict of str to tuple of str
        Rules for this job from the suite of a gate, by option: ``fail-on``, ``warn-on``, ``max``.
    fault : str
        Reason why the gate does not judge the job, for example that no file matches its pattern.
    fault_is : str
        Verdict of the gate on this job, if it has a fault.
    is_new : bool
        Whether the job is new: the target of the gate lacks it.
    in_scene : bool
        Whether a new job fails if it is dead, because only its seed and its truth are new.
    in_memory : mapping of str to object
        Data in memory, under the keys ``truth`` and ``estimate``. For such data, the parameter
        `truth` or `estimate` is a name to show, not a path. The key ``mapping`` says which
        components of arrays are compared.
    digest : str
        Digest of the data in memory.
    """

    truth: str = ""
    estimate: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    frames: tuple[int, int] | None = None
    name: str = ""
    rules: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    fault: str = ""
    fault_is: str = "error"
    is_new: bool = False
    in_scene: bool = False
    in_memory: Mapping[str, Any] = field(default_factory=dict)
    digest: str = ""

    @property
    def sides(self) -> tuple[Any, Any]:
        """Truth and estimate, each as data in memory or as a path."""
        known = self.in_memory.get
        return known("truth", self.truth), known("estimate", self.estimate)

    @property
    def files(self) -> tuple[str, ...]:
        """Paths of truth and estimate, without those in memory."""
        return tuple(filter(is_path, self.sides))

    @property
    def title(self) -> str:
        """Values of the labels in one line; without labels, the path of the estimate."""
        return "/".join(self.labels.values()) or self.estimate


@dataclass(frozen=True, kw_only=True)
class BatchPlan:
    """All jobs of a batch, and faults of its files.

    Parameters
    ----------
    jobs : tuple of Job
        Jobs for which both truth and estimate exist.
    faults : tuple of str
        Estimates without truth, truths without estimate, and paths that match in two ways.
    notices : tuple of str
        Messages about skipped files.
    """

    jobs: tuple[Job, ...]
    faults: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()


Values = dict[str, str]
"""Values of the fields of a pattern, by the name of the field."""


def match(
    truth: str,
    estimate: str,
    folders: tuple[str, str] = ("", ""),
    output: str | None = None,
    inside: patterns.Inside = runs_inside,
) -> tuple[Sequence[Values], Sequence[tuple[str, Values]], tuple[str, ...]]:
    """Match both patterns, and return the field values of truths, the estimates, and notices.

    An estimate is a tuple of its path and its field values. If the pattern of truths has no fields,
    there is one truth without values. Notices are about skipped files. The arguments are those of
    `of_patterns`.
    """
    truths, passed_over = patterns.match_files(truth, folders[0], output=output, inside=inside)
    estimates, more = patterns.match_files(
        estimate, folders[1], output=output, truth=(truth, folders[0]), inside=inside
    )
    values = [own for _, own in truths] if patterns.fields(truth) else [{}]
    return values, estimates, tuple((passed_over | more).values())


def groups_of(files: Iterable[Mapping[str, str]], fields: Sequence[str]) -> list[Values]:
    """Return the different combinations of values that these fields have in files.

    `files` has the field values of each file. The fields, such as ``tracker``, are those that only
    estimates have.
    """
    groups = dict.fromkeys(tuple(values[name] for name in fields) for values in files)
    return [dict(zip(fields, group, strict=True)) for group in groups]


def of_patterns(
    truth: str,
    estimate: str,
    folders: tuple[str, str] = ("", ""),
    sequences: Collection[str] = (),
    output: str | None = None,
    inside: patterns.Inside = runs_inside,
) -> BatchPlan:
    """Make a job for each estimate that matches its pattern.

    In each job, a field of the truth has the same value as this field of the estimate.

    Parameters
    ----------
    truth, estimate : str
        Patterns of the files.
    folders : pair of str
        Folders of the patterns. Braces in these names are not fields.
    sequences : collection of str
        If not empty, only files with these values of the field ``sequence`` are used.
    output : str, optional
        Folder of the store, which is not searched.
    inside : callable
        Callable that receives a file and returns the names of its runs.

    Raises
    ------
    ConfigError
        No file matches a pattern, or the truth has a field that the estimates do not have.
    """
    own, theirs = patterns.fields(truth), patterns.fields(estimate)
    unknown = [name for name in own if name not in theirs]
    if unknown:
        raise ConfigError(
            f"{option('truth', truth)}: the field {{{unknown[0]}}} is not in "
            f"{option('estimate', estimate)}"
        )
    jobs, faults = [], []
    truths, estimates, notices = match(truth, estimate, folders, output, inside)
    for path, values in estimates:
        if sequences and values["sequence"] not in sequences:
            continue
        whole = os.path.join(folders[1], path)
        if patterns.is_ambiguous(estimate, path):
            faults.append(f"{whole}: the fields of {estimate} match it in two ways")
            continue
        theirs_truth = os.path.join(folders[0], patterns.fill(truth, values))
        if not _is_there(theirs_truth, inside):
            faults.append(f"{whole}: ground truth {_why_absent(theirs_truth)}")
            continue
        jobs.append(Job(labels=values, truth=theirs_truth, estimate=whole))
    if not jobs and not faults and not sequences:
        what = "file" if file_of(estimate) == estimate else "variable of a file"
        raise ConfigError(f"{option('estimate', estimate)}: no {what} matches", *notices)
    groups = groups_of((job.labels for job in jobs), [name for name in theirs if name not in own])
    known = {frozenset(job.labels.items()) for job in jobs}
    for values, group in itertools.product(truths, groups):
        is_chosen = not sequences or values["sequence"] in sequences
        if is_chosen and frozenset((values | group).items()) not in known:
            paths = patterns.fill(truth, values), patterns.fill(estimate, values | group)
            lone, missing = map(os.path.join, folders, paths)
            faults.append(f"{lone}: there is no estimate {missing}")
    return BatchPlan(jobs=tuple(jobs), faults=tuple(faults), notices=notices)


def _is_there(path: str, inside: patterns.Inside) -> bool:
    """Return whether a path has data.

    For a path such as ``FILE.mat:Y{3}``, the file must also have this element.
    """
    file = file_of(path)
    has = file == path or not path.endswith("}") or path[len(file) + 1 :] in inside(file)
    return _has_data(file) and has


def _has_data(path: str) -> bool:
    return os.path.isfile(path) or folder_format(path) != ""


def _why_absent(path: str) -> str:
    """Return a path, and why it has no data for a job."""
    why = "is a folder; batch takes files" if os.path.isdir(path) else "does not exist"
    return f"{path} {why}"


def of_layout(
    layout: str,
    truth: str,
    trackers: str,
    sequences: Collection[str] = (),
    output: str | None = None,
) -> BatchPlan:
    """Make the jobs of a benchmark from its folders.

    If `sequences` is empty, all sequences are used.

    Raises
    ------
    ConfigError
        A folder does not have this layout. The message names nearby folders that have it.
    """
    shapes, folders = LAYOUTS[layout], (truth, trackers)
    wrong = [
        _elsewhere(layout, shape, folder)
        for shape, folder in zip(shapes, folders, strict=True)
        if next(patterns.matching_paths(shape, folder), None) is None
    ]
    if wrong:
        raise ConfigError(*wrong)
    plan = of_patterns(*shapes, folders, sequences, output)
    left = set(sequences) - {job.labels["sequence"] for job in plan.jobs}
    missing = [f"sequence {name}: there is no truth, or no tracker has it" for name in sorted(left)]
    return replace(plan, faults=(*plan.faults, *missing))


def layout_of(truth: str, trackers: str) -> str | None:
    """Return the benchmark layout of two folders; None if they match none."""
    for layout, shapes in LAYOUTS.items():
        if all(
            next(patterns.matching_paths(shape, folder), None)
            for shape, folder in zip(shapes, (truth, trackers), strict=True)
        ):
            return layout
    return None


def _elsewhere(layout: str, shape: str, folder: str) -> str:
    """Describe a folder that does not have this layout, and name nearby folders that have it."""
    if not os.path.isdir(folder):
        fault = "is a file, not a folder" if os.path.exists(folder) else "no such folder"
        return f"{folder}: {fault}, as {option('layout', layout)} needs"
    near = []
    for level in range(1, NEARBY_LEVELS + 1):
        above = os.path.normpath(os.path.join(folder, *[os.pardir] * level))
        near += [above] if next(patterns.matching_paths(shape, above), None) else []
        inner = "/".join(f"{{inner{k}}}" for k in range(level))
        below = (values for _, values in patterns.matching_paths(f"{inner}/{shape}", folder))
        near += sorted({os.path.join(folder, patterns.fill(inner, values)) for values in below})
    name = f"; name {'one of ' if len(near) > 1 else ''}{listed(near, 3)}" if near else ""
    return f"{folder}: has no {shape}, as {option('layout', layout)} needs{name}"


def read_sequences(path: str) -> list[str]:
    """Read the names of sequences from a seqmap, one per line; a heading ``name`` is left out."""
    names = [words[0] for words in _words(path) if words]
    names = names[1:] if names[:1] == ["name"] else names
    if not names:
        raise InputError(f"{path}: has no sequence; write one sequence per line")
    return names


def with_frames(plan: BatchPlan, layout: str, truth: str, seqmap: str | None = None) -> BatchPlan:
    """Add the frames that a benchmark declares for each sequence.

    Parameters
    ----------
    plan : BatchPlan
        Jobs of the layout.
    layout, truth : str
        Name of the layout, and folder of the truth.
    seqmap : str, optional
        Seqmap of KITTI. It is searched before the seqmap in the folder of the truth.

    Raises
    ------
    InputError
        A declaration is not valid.
    """
    names = list(dict.fromkeys(job.labels["sequence"] for job in plan.jobs))
    if layout == "motchallenge":
        frames = {name: _frames_of_seqinfo(os.path.join(truth, name, SEQINFO)) for name in names}
    else:
        frames = dict.fromkeys(names)
        # In the folder of the truth, the seqmap of the training sequences is read. If there is no
        # such seqmap, the only other seqmap is read.
        there = glob.glob(os.path.join(glob.escape(truth), f"{SEQMAP}*"))
        there = [path for path in there if path.endswith(".training")] or there
        for path in (seqmap, there[0] if len(there) == 1 else None):
            missing = [name for name in names if frames[name] is None]
            frames |= _frames_of_seqmap(path, missing) if path and missing else {}
    missing = [name for name in names if frames[name] is None]
    notice = (
        f"{truth}: no {DECLARED_IN[layout]} for {listed(missing, 3)}: values per step are divided "
        "by the number of times in the ground truth"
    )
    return replace(
        plan,
        jobs=tuple(replace(job, frames=frames[job.labels["sequence"]]) for job in plan.jobs),
        notices=(*plan.notices, *([notice] if missing else ())),
    )


def _frames_of_seqinfo(path: str) -> tuple[int, int] | None:
    """Return the frames of a sequence, 1 to seqLength; None if the file does not declare them."""
    if not os.path.lexists(path):
        return None
    ranges = set()
    for number, line in enumerate(decode(load(path), path).split("\n"), 1):
        named = re.fullmatch(r"\s*seqLength\s*[=:](.*)", line, re.IGNORECASE)
        if named is None:
            continue
        length = parsed_whole(named[1])
        if length is None or not 1 <= length <= MAX_STEPS:
            raise InputError(
                f"{path}, line {number}: seqLength is {quoted(named[1].strip())}; it must be the "
                f"number of frames, 1 to {MAX_STEPS:,}"
            )
        ranges.add((1, length))
    if len(ranges) > 1:
        raise InputError(f"{path}: seqLength is given twice, with different values")
    return ranges.pop() if ranges else None


def _frames_of_seqmap(path: str, names: Collection[str]) -> dict[str, tuple[int, int]]:
    """Return the frames of these sequences from lines such as ``0000 empty 000000 000154``.

    The last number is the last frame plus 1: this sequence has the frames 0 to 153.
    """
    frames: dict[str, tuple[int, int]] = {}
    for number, words in enumerate(_words(path), 1):
        if len(words) < 4 or words[0] not in names:
            continue
        first, end = map(parsed_whole, words[2:4])
        if first is None or end is None or not 0 <= first < end <= MAX_STEPS:
            raise InputError(
                f"{path}, line {number}: {quoted(' '.join(words[2:4]))} must be the first frame "
                f"and the one after the last, from 0 to {MAX_STEPS:,}, such as 000000 000154"
            )
        if frames.setdefault(words[0], (first, end - 1)) != (first, end - 1):
            raise InputError(
                f"{path}, line {number}: {words[0]} is given twice, with different values"
            )
    return frames


def _words(path: str) -> list[list[str]]:
    """Return the words of each line of a seqmap."""
    return [line.replace(",", " ").split() for line in decode(load(path), path).split("\n")]


ALIASES = {"c": "cutoff", "p": "order", "g": "switch-penalty", "gamma": "switch-penalty"}
"""Other names of options on the command line."""


def _near_option(name: str, options: Collection[str]) -> str | None:
    """Return the option that the name of a column is likely to mean; None if there is none."""
    plain = {re.sub("[-_]", "", key): key for key in sorted(options, reverse=True)}
    text = re.sub(r"[-_\s]", "", name).lower()
    if ALIASES.get(text) in options:
        return ALIASES[text]
    near = (
        key for key in plain if len(key) > 5 and _differ_by_a_letter(*sorted((text, key), key=len))
    )
    return plain.get(text) or next((plain[key] for key in near), None)


def _differ_by_a_letter(short: str, long: str) -> bool:
    """Return whether one letter differs, or whether the longer text has one more letter.

    An s at the end, as in a plural, does not count as one more letter.
    """
    if len(short) == len(long):
        return sum(a != b for a, b in zip(short, long, strict=True)) == 1
    return f"{short}s" != long and short in {long[:k] + long[k + 1 :] for k in range(len(long))}


def of_manifest(path: str, options: Collection[str]) -> BatchPlan:
    """Make a job from each row of a manifest, a table with paths, labels and options.

    Parameters
    ----------
    path : str
        CSV file. Paths in it are relative to its folder.
    options : collection of str
        Names of columns that are options. All other columns are labels.

    Raises
    ------
    InputError
        The file is missing or not a valid manifest.
    """
    data = load(path, LARGEST_MANIFEST)
    lines, rows = rows_of(data, path, decimal=".") if data else ([], [])
    lacking = [name for name in PATHS if not rows or name not in rows[0]]
    if lacking:
        raise InputError(
            f"{path}, line 1: no column {' and '.join(lacking)}; a manifest has the columns truth "
            "and estimate"
        )
    head, folder = rows[0], os.path.dirname(path)
    if len(set(head)) < len(head):
        raise InputError(f"{path}, line 1: a column name is a duplicate")
    if len(rows) == 1:
        raise InputError(f"{path}: has no jobs, only a header; add a line for each job")
    for name in head:
        near = None if name in (*PATHS, *options) else _near_option(name, options)
        if near is not None:
            raise InputError(
                f"{path}, line 1: column {quoted(name)} is not an option; did you mean {near}? "
                "If it is a label of the jobs, give it a name that is less like an option"
            )
    jobs, faults = [], []
    for line, row in zip(lines[1:], rows[1:], strict=True):
        if len(row) != len(head):
            raise InputError(f"{path}, line {line}: {len(row)} fields, the header has {len(head)}")
        values = dict(zip(head, row, strict=True))
        job = Job(
            labels={
                name: text.strip() or '""'
                for name, text in values.items()
                if name not in (*PATHS, *options)
            },
            truth=os.path.join(folder, values["truth"]),
            estimate=os.path.join(folder, values["estimate"]),
            options={name: text for name, text in values.items() if name in options and text},
        )
        absent = [name for name in (job.truth, job.estimate) if not _has_data(file_of(name))]
        faults += [f"{path}, line {line}: {_why_absent(name)}" for name in absent]
        if not absent:
            jobs.append(job)
    keys = set()
    for job in jobs:
        key = (*job.labels.items(), *job.options.items())
        if key in keys:
            raise InputError(
                f"{path}: two rows have the name {quoted(job.title)}; add a column with different "
                "values, such as run"
            )
        keys.add(key)
    return BatchPlan(jobs=tuple(jobs), faults=tuple(faults))


# -------------------------------------------------------------------------------------------------
# Runs in memory.


def runs_in_memory(
    truth: Any, estimates: Mapping[str, Any]
) -> tuple[list[str], list[Any], dict[str, list[Any]]]:
    """Return the names of the runs, the truth of each run, and the runs of each estimate.

    A truth without runs is the truth of every run. If no estimate has runs either, there is one run
    with a blank name.

    Raises
    ------
    InputError
        Truth and estimates have different runs.
    """
    sides = [("truth", truth), *estimates.items()]
    each = [(name, side, runs_of(side, name)) for name, side in sides]
    several = [(name, runs) for name, _, runs in each if runs is not None]
    if not several:
        return [""], [truth], {name: [side] for name, side in estimates.items()}
    first, runs = next((one for one in several if one[1][:1] and one[1][0][0]), several[0])
    size = len(str(len(runs)))
    names = [name or f"{k:0{size}}" for k, (name, _) in enumerate(runs, 1)]
    made: list[list[Any]] = []
    for k, (name, side, own) in enumerate(each):
        own = [("", side)] * (1 if k else len(names)) if own is None else own
        if len(own) != len(names):
            raise InputError(
                f"{first} has {counted(len(names), 'run')}, {name} {len(own)}: all must have the "
                "same number, except a single truth for all; a run without objects is []"
            )
        wrong = next((run for run, _ in own if run and run not in names), None)
        if wrong is not None:
            raise InputError(
                f"{name}: {first} has no run {quoted(wrong)}; all must have the same runs"
            )
        made.append([run for _, run in own])
    return names, made[0], dict(zip(estimates, made[1:], strict=True))


def named_sides(estimates: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the same estimates, with their names converted to text.

    Raises
    ------
    InputError
        Two names have the same text.
    """
    sides = {str(name): side for name, side in estimates.items()}
    if len(sides) < len(estimates):
        names = list(map(str, estimates))
        twice = next(name for k, name in enumerate(names) if name in names[:k])
        raise InputError(f"two estimates are called {quoted(twice)}; give each its own name")
    return sides


def of_memory(truth: Any, estimates: Any, mapping: Any = None) -> BatchPlan:
    """Make the jobs of data in memory: one job for each run of each tracker.

    If `estimates` is a mapping, its keys are the names of the trackers. Otherwise, it is the data
    of one tracker without a name.

    Raises
    ------
    InputError
        Truth and estimates have different runs, or one of them has no run.
    """
    from joblib import hash as digest_of  # lazy: slow to import

    is_named = isinstance(estimates, Mapping)
    trackers = named_sides(estimates) if is_named else {"estimate": estimates}
    names, truths, own = runs_in_memory(truth, trackers)
    digests = [digest_of(one) for one in (truths if truths[0] is not truths[-1] else truths[:1])]
    jobs = []
    for tracker, k in itertools.product(own, range(len(names))):
        labels = {"tracker": tracker} if is_named or names[k] else {}
        labels |= {"run": names[k]} if names[k] else {}
        sides = {"truth": truths[k], "estimate": own[tracker][k]}
        in_memory = {role: side for role, side in sides.items() if not is_path(side)}
        of_all = f"truth {names[k]}".rstrip() if len(digests) > 1 else "truth"
        paths: dict[str, Any] = {
            "truth": of_all,
            "estimate": "/".join(labels.values()) or "estimate",
        }
        paths |= {role: os.fsdecode(side) for role, side in sides.items() if is_path(side)}
        if in_memory:
            in_memory |= {"mapping": mapping}
        digest = digest_of((digests[k % len(digests)], sides["estimate"], mapping))
        jobs.append(Job(**paths, labels=labels, in_memory=in_memory, digest=digest))
    return BatchPlan(jobs=tuple(jobs))


# -------------------------------------------------------------------------------------------------
# Runs of a comparison. Each text that ``*`` matches is a run. Without ``*``, each combination of
# values of the fields of the truth is a run.

Runs = list[tuple[str, list[str]]]
"""Path of the truth and paths of the estimates, for each run."""

AS_FIELD = "{run}"
"""Field that replaces a *."""


def is_pattern(path: str) -> bool:
    """Return whether a path has a ``*`` or a field, and is not the name of an existing file."""
    return ("*" in path or bool(patterns.fields(path))) and not os.path.exists(path)


def first_file(pattern: str) -> str | None:
    """Return the first file that matches a pattern."""
    shape = pattern.replace("*", AS_FIELD, 1)
    return next((name for name, _ in patterns.matching_paths(shape, inside=runs_inside)), None)


def compared_runs(
    truth: str, estimates: Sequence[str], output: str | None = None
) -> tuple[Runs, tuple[str, ...], tuple[str, ...]]:
    """Return the files of each run, the path or pattern of each estimate, and notices.

    A truth that is not a pattern is the truth of all runs. A field that only a pattern of estimates
    has, such as ``{tracker}``, stands for several estimates. Names of existing files are not
    patterns. Notices are about skipped files.

    Parameters
    ----------
    truth : str
        Path or pattern of the truth.
    estimates : sequence of str
        Paths or patterns of the estimates.
    output : str, optional
        Folder in which no estimates are searched.

    Raises
    ------
    ConfigError, InputError
        A pattern matches no file, patterns have different runs, or a file name has braces.
    """
    own = _fields(truth)
    each: list[str] = []
    notices = _hidden(truth)
    for path in estimates:
        own_fields = [name for name in _fields(path) if name not in own]
        if not own_fields:
            each.append(path)
            notices |= _hidden(path)
            continue
        files, left = patterns.match_files(
            path, output=output, truth=(truth, ""), inside=runs_inside
        )
        notices |= {why if why == patterns.DOTTED else text: text for why, text in left.items()}
        groups = groups_of(_values(path, files, left.values()), own_fields)
        for text in itertools.chain(*(group.values() for group in groups)):
            if own and patterns.fields(text):
                raise InputError(
                    f"{path}: matches {text}, which has braces like a field; rename it"
                )
        kept = {name: f"{{{name}}}" for name in own}
        groups.sort(key=lambda group: tuple(map(natural, group.values())))
        each += [patterns.fill(path, kept | group) for group in groups]
    return expand(truth, each), tuple(each), tuple(notices.values())


def expand(truth: str, estimates: Sequence[str]) -> Runs:
    """Return the files of each run; within a run, a field has the same value in all patterns.

    Raises
    ------
    ConfigError, InputError
        A pattern matches no file, or patterns have different runs or fields.
    """
    paths = (truth, *estimates)
    marked = [path for path in paths if is_pattern(path)]
    stars = [path for path in marked if not patterns.fields(path)]
    if not marked:
        return [(truth, list(estimates))]
    if stars and len(stars) < len(marked):
        fielded = next(path for path in marked if path not in stars)
        raise ConfigError(
            f"{stars[0]}: has a *, but {fielded} has fields; use only * or only fields"
        )
    for path in paths:
        if path in stars and path.count("*") > 1:
            raise ConfigError(f"{path}: must have a single *, in place of the run")
        if stars and path not in marked and path != truth:
            raise ConfigError(f"{path}: has no * in place of the run, but other files have one")
    own = ["run"] if stars else _fields(truth)
    for path in estimates:
        missing = [] if stars else [name for name in own if name not in _fields(path)]
        if missing:
            raise ConfigError(f"{path}: has no {{{missing[0]}}}, but {truth} has it")
    there = {path: list(_values(path)) for path in marked}
    runs = sorted(there[marked[0]], key=lambda values: [natural(values[name]) for name in own])
    for path in marked[1:]:
        for values in (values for values in runs if values not in there[path]):
            raise InputError(
                f"{_file(path, values)}: no such file, but other patterns have this run"
            )
        for values in (values for values in there[path] if values not in runs):
            raise InputError(f"{_file(path, values)}: this run is missing in other patterns")
    return [(_file(truth, values), [_file(path, values) for path in estimates]) for values in runs]


def _file(path: str, values: Mapping[str, str]) -> str:
    """Return the file of a run; a path without a pattern is the file of all runs."""
    return patterns.fill(_shape(path), values) if is_pattern(path) else path


def _shape(pattern: str) -> str:
    """Return the pattern with a field instead of its ``*``; unchanged if it has fields."""
    return pattern if patterns.fields(pattern) else pattern.replace("*", AS_FIELD)


def _fields(path: str) -> list[str]:
    """Return the fields of a pattern; none for the name of an existing file."""
    return patterns.fields(path) if is_pattern(path) else []


def _hidden(pattern: str) -> dict[str, str]:
    """Return the notice about hidden files that a pattern skips, by its kind; empty without any."""
    if not is_pattern(pattern):
        return {}
    _, left = patterns.match_files(_shape(pattern), inside=runs_inside)
    dotted = {why: text for why, text in left.items() if why == patterns.DOTTED}
    star = not patterns.fields(pattern)
    return {why: text.replace(AS_FIELD, "*") if star else text for why, text in dotted.items()}


def _values(
    pattern: str,
    files: Iterable[tuple[str, Mapping[str, str]]] | None = None,
    notices: Iterable[str] = (),
) -> Iterator[Mapping[str, str]]:
    """Yield the field values of each of the files, by default of all that match the pattern.

    If there are no files, the error also shows `notices`.

    Raises
    ------
    InputError
        No file matches the pattern, or a file matches it in two ways.
    """
    shape = _shape(pattern)
    matches = list(patterns.matching_paths(shape, inside=runs_inside) if files is None else files)
    if not matches:
        raise InputError(f"{pattern}: no such files", *notices)
    for path, values in matches:
        if patterns.is_ambiguous(shape, path):
            raise InputError(f"{path}: the fields of {pattern} match it in two ways")
        yield values


def short_names(paths: Sequence[str]) -> list[str]:
    """Return a short name for each file: the part of its path that differs from other paths.

    Raises
    ------
    ConfigError
        A file is given twice.
    """
    by_real_path: dict[str, str] = {}
    for path in paths:
        other = by_real_path.setdefault(os.path.realpath(path), path)
        if other != path:
            raise ConfigError(f"{path}: is the same as {other}; name each estimate once")
    if len(set(paths)) < len(paths):
        twice = next(path for path in paths if paths.count(path) > 1)
        raise ConfigError(f"{twice}: is given twice")
    parts = [Path(path).with_suffix("").parts for path in paths]
    if len(paths) == 1:
        return [parts[0][-1]]
    for _ in range(2):  # removes a common beginning, then a common end
        levels = enumerate(zip(*parts, strict=False))
        same = next((k for k, names in levels if len(set(names)) > 1), min(map(len, parts)))
        parts = [part[same:][::-1] for part in parts]
    names = ["/".join(part) for part in parts]
    return names if len(set(names)) == len(names) and all(names) else list(paths)
