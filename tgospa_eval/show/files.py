"""A result as files: JSON, CSV tables and the report. A new folder appears only when complete."""

import hashlib
import itertools
import json
import os
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import quote

import numpy as np

from tgospa_eval.common import writing as manifest
from tgospa_eval.common.files import named
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import counted
from tgospa_eval.common.writing import FRESH, is_left, turn, unique, writing
from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation.pair import EvaluationByClass, PairEvaluation, explanation_of
from tgospa_eval.problem.solution import read_assigned, read_switches, read_tracks
from tgospa_eval.problem.states import ONE, assigned, spare
from tgospa_eval.quoting import as_unicode, option
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.partitioned import PartitionedResult
from tgospa_eval.results.records import Json, PairProof
from tgospa_eval.results.slices import slices_columns
from tgospa_eval.sensors import Pairing
from tgospa_eval.show.chart_list import pictures
from tgospa_eval.show.style import FILES
from tgospa_eval.show.table_text import csv_text
from tgospa_eval.tracks.places import EARTH, on_earth

Files: TypeAlias = Mapping[str, str | bytes | Path]
"""Contents of files by name. A path stands for the content of the file at this path."""

PICTURES = tuple(FILES)
AS_FORMAT = {".json": "json", ".csv": "csv", ".md": "markdown", ".tex": "latex"}


@dataclass(frozen=True, kw_only=True)
class Kind:
    """Kind of folder that this program writes, such as the result of an evaluation.

    Parameters
    ----------
    name : str
        Name of the kind in manifests.
    document : str
        File that is removed first and written last. Therefore this file is never in a folder
        together with files of another run.
    names : collection of str
        Files of every folder of the kind. Before the work begins, it is checked that none of them
        exists, except as an unchanged file of an earlier run.
    log : str, optional
        Log file of long work. If a folder has no manifest, this file tells its kind.
    opens : tuple of str
        Files that a user can open. The final message recommends the first of them that exists.
    """

    name: str
    document: str
    names: Collection[str]
    log: str | None = None
    opens: tuple[str, ...] = ("report.html",)

    def owns(self, folder: Path) -> bool:
        """Check whether a folder is of this kind, without reading its log."""
        if manifest.read_manifest(folder, self.name) is not None:
            return True
        if self.log is None or not (folder / self.log).is_file():
            return False
        # A study that is killed early leaves an empty log as the only file.
        return bool((folder / self.log).stat().st_size) or len(list(manifest.visible(folder))) == 1


WORK_FOLDER = "work"
"""Subfolder for the work on data in parts. A run that was interrupted continues from its files."""

WORK_LOG = f"{WORK_FOLDER}/run.json"

RESULT = Kind(
    name="result",
    document="result.json",
    names=(
        "result.json",
        *("per_step.csv", "assignments.csv", "switches.csv", "per_truth.csv", "per_estimate.csv"),
        "timings.csv",
        "report.html",
    ),
    log=WORK_LOG,
)

GEOJSON = "result.geojson"

PROOF_FILES = ("proof.json", "truth.csv", "estimate.csv", "distances.csv")
PROOF = Kind(name="proof", document="proof.json", names=PROOF_FILES)
SWEEP = Kind(
    name="sweep",
    document="sweep.json",
    names=("sweep.json", "sweep.csv", "report.html"),
)
ASSOCIATION = Kind(
    name="associate",
    document="report.html",
    names=("report.html", "associate.json", "associations.csv"),
)
COMPARISON = Kind(
    name="compare",
    document="compare.json",
    names=("compare.json", "compare.csv", "per_step.csv", "pairs.csv", "report.html"),
)
STUDY = Kind(
    name="study",
    document="compare.json",
    names=("compare.json", "compare.csv", "report.md", "report.html"),
    log=f"runs/{manifest.STORE}",
)
GATE = Kind(
    name="gate",
    document="gate.json",
    names=("gate.json", "gate.md", "gate.html"),
    opens=("gate.html",),
)
BATCH = Kind(
    name="batch",
    document="report.html",
    names=("report.html", "curve.csv", "slices.csv"),
    log=manifest.STORE,
)


def check_folder(folder: str, kind: Kind | None = None, *, force: bool, subject: str = "") -> None:
    """Check that a folder can be written, before any work is done.

    Parameters
    ----------
    folder : str
        Path of the folder.
    kind : Kind, optional
        Kind of folder that may be overwritten.
    force : bool
        Whether the folder is accepted with any content.
    subject : str
        Beginning of messages; by default the name of the option for the folder.

    Raises
    ------
    ConfigError
        The path is empty or a file. The name of a new folder looks like that of a file. Without
        `force`: the folder has content and is not of this kind.
    """
    subject = subject or option("output")
    if not folder:
        raise ConfigError(f"{subject} is empty; name a folder")
    path = Path(folder)
    with named(f"{subject} {folder}", ConfigError, "cannot be written"):
        if path.exists() and not path.is_dir():
            raise ConfigError(f"{subject} {folder}: is a file; name a folder")
        if not path.is_dir():
            _check_name(folder, subject)
        elif not force and not (kind and kind.owns(path)) and any(manifest.visible(path)):
            raise ConfigError(
                f"{subject} {folder}: is not empty; name another folder, or {option('force', True)}"
            )


def probe_folder(
    folder: str,
    kind: Kind | None = None,
    *,
    force: bool,
    subject: str = "",
    also: Collection[str] = (),
) -> None:
    """Run `check_folder`, and check that files can be created where `write_texts` creates them.

    `also` are names of files that will be written in addition to `Kind.names`.

    Raises
    ------
    ConfigError
        `check_folder` fails, or the folder cannot be written. Without `force`: a file that would be
        overwritten is not from an earlier run, or has changed since.
    """
    subject = subject or option("output")
    check_folder(folder, kind, force=force, subject=subject)
    with named(f"{subject} {folder}", ConfigError, "cannot be written"):
        path = Path(os.path.realpath(folder))
        if path.is_symlink():
            path.stat()  # raises an error for a circular link
        there = next(above for above in (path, *path.parents) if above.exists())
        probe = there / unique()
        probe.mkdir(mode=0o700)
        with suppress(FileNotFoundError):
            probe.rmdir()
        if kind is not None and there == path and not force:
            with turn(path):
                _check_names(path, kind, (*kind.names, *also), f"{subject} {folder}")


def write_texts(
    texts: Files,
    folder: str,
    kind: Kind | None = None,
    *,
    force: bool,
    subject: str = "",
) -> str:
    """Write files into a folder; files of an earlier run of the same kind are replaced or removed.

    Return a sentence about the written files. A new folder appears only when it is complete. In an
    existing folder the old document is removed first, and the new document is written last. If two
    runs write into one folder at once, one waits for the other.

    If a `kind` is given, the folder gets a manifest. A later run removes only unchanged files that
    are in this manifest. It replaces other files only with `force`.

    Raises
    ------
    ConfigError
        `check_folder` fails, or the folder cannot be written. Without `force`: a file that would be
        overwritten is not from an earlier run, or has changed since.
    """
    subject = subject or option("output")
    check_folder(folder, kind, force=force, subject=subject)
    where = f"{subject} {folder}"
    with named(where, ConfigError, "cannot be written"):
        path = Path(os.path.realpath(folder))
        removed, files = 0, None if path.exists() else _write_new(texts, path, kind, where)
        if files is None:  # the folder exists; possibly another process has just made it
            check_folder(folder, kind, force=force, subject=subject)
            removed, files = _write_over(texts, path, kind, None if force else where)
    names = [name for name, *_ in files]
    pictures = sum(name.endswith(PICTURES) for name in names)
    counts = {"file": len(names) - pictures, "picture": pictures}
    parts = [counted(count, what) for what, count in counts.items() if count]
    text = f"wrote {' and '.join(parts)} to {os.path.join(folder, '')}"
    text += f", removed {removed} of an earlier run" if removed else ""
    shown = [name for name in (kind.opens if kind else ()) if name in names]
    return f"{text}; open {os.path.join(folder, shown[0])}" if shown else text


def _take(file: Path, place: Path, work: Path) -> None:
    """Put a file at `place`, as a hard link if the file is in the folder `work`, else as a copy."""
    if work in file.resolve().parents:
        with suppress(OSError):  # some file systems do not support hard links
            os.link(file, place)
            return
    import shutil  # lazy: it imports compression

    shutil.copyfile(file, place)


def _check_name(folder: str, subject: str) -> None:
    """Check that the name of a new folder does not look like the name of a file.

    Raises
    ------
    ConfigError
        The name has a suffix of pictures, pages, tables or texts.
    """
    stem, suffix = os.path.splitext(folder)
    suffix = suffix.lower()
    if suffix not in (*AS_FORMAT, *(f".{kind}" for kind in (*PICTURES, "html", "txt"))):
        return
    remedy = f"name it {stem}"
    if subject == option("output") and suffix in AS_FORMAT:
        remedy = f"type {option('format', AS_FORMAT[suffix])} > {folder}"
    raise ConfigError(f"{subject} {folder}: must be a folder, not a file; {remedy}")


def _check_names(path: Path, kind: Kind, names: Collection[str], where: str) -> None:
    """Check that each of these files is missing, or is unchanged since an earlier run wrote it.

    Raises
    ------
    ConfigError
        A file was not written by a run of this kind, or has changed after it was written.
    """
    own = manifest.unchanged(path, manifest.read_manifest(path, kind.name) or ())
    for name in names:
        if os.path.lexists(path / name) and name not in own:
            raise ConfigError(
                f"{where}: {name} in it was not written by an earlier run, or has changed since; "
                f"name another folder, or {option('force', True)}"
            )


def _write_all(texts: Files, folder: Path, kind: Kind | None) -> Collection[manifest.FileEntry]:
    folder.mkdir()
    files: list[manifest.FileEntry] = []
    for name, content in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, Path):
            _take(content, folder / name, folder.parent / WORK_FOLDER)
            files.append(manifest.entry(folder, name))
            continue
        data = content if isinstance(content, bytes) else content.encode()
        (folder / name).write_bytes(data)
        files.append((name, len(data), hashlib.sha256(data).hexdigest()))
    if kind is not None:
        text = manifest.text_of(kind.name, files)
        (folder / manifest.NAME).write_text(text, encoding="utf-8")
    return files


def _write_new(
    texts: Files, path: Path, kind: Kind | None, where: str
) -> Collection[manifest.FileEntry] | None:
    """Write a folder under a temporary name and rename it; return None if the folder exists."""
    try:
        with writing(path, where) as beside:
            return _write_all(texts, beside, kind)
    except OSError:
        if not path.is_dir():
            raise
        return None


def _write_over(
    texts: Files, path: Path, kind: Kind | None, where: str | None
) -> tuple[int, Collection[manifest.FileEntry]]:
    """Write into an existing folder; return the number of removed files, and the new entries.

    If `where` is None, files that no earlier run has written are overwritten. If it is a text, they
    cause an error whose message begins with this text.
    """
    import shutil

    with turn(path) as is_locked:
        for left in path.glob(f"{FRESH}*") if is_locked else ():
            if is_left(left):
                shutil.rmtree(left, ignore_errors=True)
        fresh = path / unique()
        try:
            files = _write_all(texts, fresh, kind)
            names = [name for name, *_ in files]
            if kind is not None and where is not None:
                _check_names(path, kind, names, where)
            blocked = next((name for name in names if (path / name).is_dir()), None)
            if blocked is not None:
                raise IsADirectoryError(0, f"{blocked} is a folder in it")
            if kind is not None:
                return manifest.replace_files(fresh, path, files, kind.name, kind.document), files
            for name in names:
                (path / name).parent.mkdir(parents=True, exist_ok=True)
                os.replace(fresh / name, path / name)
            return 0, files
        finally:
            shutil.rmtree(fresh, ignore_errors=True)


def result_texts(
    result: Evaluation, names: tuple[str, str] = ("truth", "estimate")
) -> dict[str, str | Path]:
    """Return the files of a result folder without pictures: texts, and paths of files to copy.

    `names` are those of truth and estimate in the report.
    """
    from tgospa_eval.show.html import page  # lazy: for folders only

    seconds = {
        stage: spent
        for stage, spent in result.timings.items()
        if stage not in ("solve", "nanoseconds_per_state")
    }
    seconds |= {f"solve/{stage}": spent for stage, spent in result.timings["solve"].items()}
    texts: dict[str, str | Path] = {
        "result.json": result.to_json(),
        "timings.csv": csv_text({"stage": list(seconds), "seconds": list(seconds.values())}),
    }
    tables = ["curve", "windows", "per_class"]
    if isinstance(result, PartitionedResult):
        texts |= result.tables.names()
    else:
        tables += ["per_step", "assignments", "switches", "per_truth", "per_estimate"]
    for name, table in ((name, result.table(name)) for name in tables):
        if table:
            texts[f"{name}.csv"] = csv_text(table)
    if result.slicings:
        texts["slices.csv"] = csv_text(slices_columns(result.slicings))
    explained = explanation_of(result)
    if explained is not None:
        texts["explanation.json"] = explained.to_json()
        texts["explanation.csv"] = csv_text(explained.columns())
    return texts | {"report.html": page(result, names)}


def check_file(
    path: str,
    subject: str,
    *,
    force: bool,
    inputs: Iterable[str] = (),
    suffixes: Collection[str] = (),
) -> str:
    """Check that a file can be written, and return its suffix.

    Parameters
    ----------
    path : str
        Path of the file.
    subject : str
        Beginning of messages.
    force : bool
        Whether an existing file is accepted.
    inputs : iterable of str
        Other files that the command reads or writes.
    suffixes : collection of str
        Allowed suffixes of the file; by default all are allowed.

    Raises
    ------
    ConfigError
        The path is a folder, is among the `inputs`, or has a suffix that is not allowed. Its folder
        is missing. Without `force`: the file exists.
    """
    with named(f"{subject} {path}", ConfigError, "cannot be written"):
        if Path(path).is_dir():
            raise ConfigError(f"{subject} {path}: is a folder; name a file")
        if not force and Path(path).exists():
            raise ConfigError(
                f"{subject} {path}: exists; name another file, or {option('force', True)}"
            )
        if not Path(path).absolute().parent.is_dir():
            raise ConfigError(f"{subject} {path}: there is no such folder; make it first")
    if any(os.path.realpath(path) == os.path.realpath(other) for other in inputs):
        raise ConfigError(
            f"{subject} {path}: is also read or written by this command; name another file"
        )
    ending = os.path.splitext(path)[1].casefold()
    if suffixes and ending not in suffixes:
        raise ConfigError(f"{subject} {path}: must end in {', '.join(suffixes)}")
    return ending


def save(result: Evaluation | Pairing, folder: "str | os.PathLike[str]", *, force: bool) -> None:
    """Write the folder of a result or an association, with pictures if matplotlib is installed."""
    path, kind = os.fspath(folder), RESULT if isinstance(result, Evaluation) else ASSOCIATION
    probe_folder(path, kind, force=force, subject="folder")
    if isinstance(result, Pairing):
        files = association_files(result)
    else:
        files = {**result_texts(result), **result_pictures(result)}
    write_texts(files, path, kind, force=force, subject="folder")


def result_pictures(result: Evaluation, *wanted: Any) -> dict[str, bytes]:
    """Return the pictures of a result folder by name; `wanted` are arguments of `pictures`."""
    parts = " in parts" if isinstance(result, PartitionedResult) else ""
    return pictures(f"result{parts}", result, *wanted)


def association_files(
    pairing: Pairing, names: tuple[str, str] = ("A", "B"), *wanted: Any
) -> dict[str, str | bytes | Path]:
    """Return the files of an association by name: page, table, and pictures.

    `wanted` are arguments of `pictures`; a single None means no pictures.
    """
    from tgospa_eval.show.html import association_page  # lazy: jinja2 is slow to import

    files: dict[str, str | bytes | Path] = {"report.html": association_page(pairing, names)}
    files["associations.csv"] = csv_text(pairing.associations_table())
    return files if wanted == (None,) else files | pictures("associate", pairing, *wanted)


# -------------------------------------------------------------------------------------------------
# Proof folders of a result: one, or one for each class if classes are evaluated separately.


NO_NAME = "%20"
"""Name of the folder of objects without a class. No other class gets it from `folder_name`."""

LONGEST_NAME = 200
"""Largest number of characters of the name of a folder. A longer name is cut to this length, and a
digest is added. File systems allow 255 characters, which is enough for both."""


def proof_files(result: Evaluation, options: Mapping[str, object]) -> dict[str, str]:
    """Return the files of the proof folder by path; if there are classes, each has its own folder.

    Parameters
    ----------
    result : Evaluation
        Result of one evaluation, or of several classes.
    options : mapping of str to object
        Options of reading and comparing, fields of `Request`, that differ from their defaults.

    Raises
    ------
    ConfigError
        There are no proof folders for this kind of evaluation.
    SolverError
        A checker finds that a folder does not prove its claim.
    """
    from tgospa_eval.proof.write import check_proofs, proof_texts  # lazy: slow to import

    files: dict[str, str] = {}
    written = []
    for folder, part, origin in sorted(_proven_parts(result), key=lambda part: part[0]):
        origin |= {
            "options": dict(options),
            "judged": part.judged,
            "inputs": {
                role: {"path": as_unicode(str(result.files[role])), "sha256": record["sha256"]}
                for role, record in part.input.items()
            },
        }
        texts = proof_texts(part.proof, origin)
        written.append(texts)
        files |= {f"{folder}{name}": text for name, text in texts.items()}
    check_proofs(written)
    return files


def _proven_parts(result: Evaluation) -> list[tuple[str, PairEvaluation, dict[str, object]]]:
    """Return the folder and result of each class, and the fields of a proof about the class."""
    if isinstance(result, EvaluationByClass):
        return [
            (f"{folder_name(name)}/", part, {"class": name, "classes": list(result.results)})
            for name, part in result.results.items()
        ]
    assert isinstance(result, PairEvaluation)
    return [("", result, {})]


def folder_name(name: str) -> str:
    """Convert a name of the user to a name for a folder; different names stay different."""
    text = quote(name, safe=" ")
    if text.startswith("."):
        text = f"%2E{text[1:]}"
    if len(text) > LONGEST_NAME:
        text = f"{text[:LONGEST_NAME]}%~{hashlib.sha256(name.encode()).hexdigest()[:16]}"
    return text or NO_NAME


def save_proof(proof: PairProof, folder: "str | os.PathLike[str]", *, force: bool = False) -> None:
    """Write one proof folder; the public method is `Proof.save`.

    Raises
    ------
    ConfigError
        The folder cannot be written or has other files, or this kind of result has no proof.
    SolverError
        A checker finds that the folder does not prove its claim.
    """
    from tgospa_eval.proof.write import check_proofs, proof_texts  # lazy: slow to import

    texts = proof_texts(proof)
    check_proofs([texts])
    write_texts(texts, os.fspath(folder), PROOF, force=force, subject="folder")


# -------------------------------------------------------------------------------------------------
# A result on a map as GeoJSON (RFC 7946): tracks, missed and false targets, errors, switches.

ROLES = ("truth", "estimate")
UNASSIGNED = ("missed", "false")


def geojson(result: Evaluation) -> str:
    """Return the text of a GeoJSON file; the property ``kind`` of each feature names its kind.

    Raises
    ------
    ConfigError
        The states are not on the Earth, or the result is of data in parts.
    """
    made: list[Json] = []
    parts = result.results if isinstance(result, EvaluationByClass) else {"": result}
    for name, part in parts.items():
        if not isinstance(part, PairEvaluation):
            raise ConfigError(
                f"{option('geojson')}: not supported for data in parts; evaluate a part"
            )
        places = _places(part)
        features = [*_tracks(part, places), *_unassigned(part, places), *_pairs(part, places)]
        for feature in (*features, *_switches(part, places)):
            if isinstance(result, EvaluationByClass):
                feature["properties"]["class"] = name
            made.append(feature)
    document = {"type": "FeatureCollection", "features": made}
    return json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n"


def _places(result: PairEvaluation) -> tuple[list[list[float]], list[list[float]]]:
    """Return positions of the rows of truth and estimate: longitude, latitude, possibly height."""
    compared = result.proof.compared
    states = compared.truth, compared.estimate
    columns = compared.columns
    if columns != EARTH[: len(columns)]:
        origin: Any = compared.settings.get("origin")
        if origin is None or "truth_crs" not in compared.settings:
            raise ConfigError(
                f"{option('geojson')} needs places on the Earth, and the states are "
                f"{','.join(columns)}; give {option('truth_crs')}, {option('estimate_crs')} and "
                f"{option('origin')}"
            )
        states = on_earth(states[0], origin), on_earth(states[1], origin)
    first, second = (
        np.column_stack((np.mod(side[:, 1] + 180, 360) - 180, side[:, 0], side[:, 2:])).tolist()
        for side in states
    )
    return first, second


def _feature(kind: str, places: list[list[float]], **properties: object) -> Json:
    """Return a feature: a point, or a line through several positions, split at the date line."""
    if len(places) == 1:
        shape: Json = {"type": "Point", "coordinates": places[0]}
    else:
        parts = _parted(places)
        shape = {"type": "LineString", "coordinates": parts[0]}
        if len(parts) > 1:
            shape = {"type": "MultiLineString", "coordinates": parts}
    return {"type": "Feature", "geometry": shape, "properties": {"kind": kind, **properties}}


def _parted(places: list[list[float]]) -> list[list[list[float]]]:
    parts = [[places[0]]]
    for before, after in itertools.pairwise(places):
        if abs(after[0] - before[0]) > 180.0:
            parts.append([])
        parts[-1].append(after)
    return [part if len(part) > 1 else part * 2 for part in parts]


def _tracks(result: PairEvaluation, places: tuple[list[list[float]], ...]) -> Iterator[Json]:
    """Yield each trajectory as a line, with its cost."""
    states, weights = result.proof.states, result.proof.weights
    labels, times = (result.labels.truths, result.labels.estimates), result.labels.times
    for of, (side, names) in enumerate(zip(states.problem.sides, labels, strict=True)):
        costs = read_tracks(states, weights, of)
        total = result.scale * (costs.localisation + costs.unassigned + costs.switch)
        order = np.argsort(side.track, kind="stable")
        first = np.searchsorted(side.track[order], np.arange(side.count + 1))
        for track, name in enumerate(names):
            rows = order[first[track] : first[track + 1]].tolist()
            if rows:
                yield _feature(
                    ROLES[of],
                    [places[of][row] for row in rows],
                    id=name,
                    first=times[side.step[rows[0]]],
                    last=times[side.step[rows[-1]]],
                    states=len(rows),
                    cost=float(total[track]),
                )


def _unassigned(result: PairEvaluation, places: tuple[list[list[float]], ...]) -> Iterator[Json]:
    """Yield each state that is missed or false."""
    proof = result.proof
    _, entry, weight = assigned(proof.states, proof.weights)
    labels = result.labels.truths, result.labels.estimates
    for of, (side, names) in enumerate(zip(proof.states.problem.sides, labels, strict=True)):
        free = spare(side, entry, weight) / ONE
        for row in np.flatnonzero(free * side.price).tolist():
            yield _feature(
                UNASSIGNED[of],
                [places[of][row]],
                id=names[side.track[row]],
                t=result.labels.times[side.step[row]],
                cost=float(result.scale * side.price[row] * free[row]),
            )


def _pairs(result: PairEvaluation, places: tuple[list[list[float]], ...]) -> Iterator[Json]:
    """Yield a line from the truth to the estimate for each assigned pair, with its distance."""
    problem = result.proof.states.problem
    entry = read_assigned(result.proof.states, result.proof.weights).entry
    table = result.table("assignments")
    rows = zip(
        *(table[name] for name in ("truth", "estimate", "t", "distance", "cost")), strict=True
    )
    for at, (truth, estimate, t, distance, cost) in zip(entry.tolist(), rows, strict=True):
        ends = places[0][problem.truth_row[at]], places[1][problem.estimate_row[at]]
        yield _feature(
            "error", list(ends), truth=truth, estimate=estimate, t=t, distance=distance, cost=cost
        )


def _switches(result: PairEvaluation, places: tuple[list[list[float]], ...]) -> Iterator[Json]:
    """Yield a point for each switch: the last position of its object at or before the switch."""
    truths = result.proof.states.problem.sides[0]
    switches = read_switches(result.proof.states, result.proof.weights)
    key = truths.track.astype(np.int64) * (len(result.labels.times) + 1) + truths.step
    order = np.argsort(key)
    wanted = switches.truth.astype(np.int64) * (len(result.labels.times) + 1) + switches.step
    row = order[np.maximum(np.searchsorted(key[order], wanted, side="right") - 1, 0)]
    table = result.table("switches")
    for at, k in zip(row.tolist(), range(len(table["t"])), strict=True):
        own: Mapping[str, Any] = {name: column[k] for name, column in table.items()}
        yield _feature("switch", [places[0][at]], **own)
