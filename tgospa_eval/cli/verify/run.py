"""Check proof folders, and that their tables follow from the files they came from."""

import inspect
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.settings import make_settings
from tgospa_eval.cli.shared.streams import emit, print_notice
from tgospa_eval.cli.shared.values import EvaluationOptions, OutputOptions
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.evaluation.prepare import Prepared, fit, prepare
from tgospa_eval.proof import verify_tgospa
from tgospa_eval.proof.tables import difference, proof_tables
from tgospa_eval.proof.write import proof_parameters
from tgospa_eval.reports.folders import PROOF_FOLDER

Files = tuple[str, str]

ROW_OPTIONS = (
    *("columns", "truth_columns", "estimate_columns", "time_tolerance", "grid", "on_duplicate"),
    *("interpolate", "max_gap", "time_offset", "time_scale", "unit_scale"),
    *("time", "class_", "truth_class", "estimate_class", "region"),
)
"""Options that say which rows and columns of the files are in the tables: part of a verdict."""


def program() -> str:
    """The text of the program that checks."""
    return inspect.getsource(verify_tgospa)


def verify_folder(folder: str, files: Files | None) -> bool:
    """Check the proof in a folder, or one for each class; whether all claims hold.

    Parameters
    ----------
    folder : str
        A proof folder, or a result folder with one in it.
    files : pair of str, optional
        The files that the tables came from.

    Raises
    ------
    InputError
        It is no proof folder, or a file is missing or damaged.
    """
    folders = _folders(folder)
    verdicts = [*_missing_classes(folder, folders), *(_verdict(path, files) for path in folders)]
    for text, holds in verdicts:
        (emit if holds else print_notice)(f"{text}\n" if holds else text)
    return all(holds for _, holds in verdicts)


def _folders(folder: str) -> list[str]:
    """The folders that have a proof: the one that was named, or those of classes in it."""
    for path in (folder, os.path.join(folder, PROOF_FOLDER)):
        found = [path] if _has_proof(path) else list(filter(_has_proof, _below(path)))
        if found:
            return found
    raise InputError(
        f"{folder}: there is no proof.json in it; evaluate TRUTH ESTIMATE -o DIR --proof writes one"
    )


def _missing_classes(folder: str, folders: list[str]) -> Iterator[tuple[str, bool]]:
    """A line for each class that has no proof of its own, where classes were proven apart."""
    if folders == [folder]:
        return
    there, needed = set(), set()
    for path in folders:
        with suppress(OSError, ValueError), open(os.path.join(path, "proof.json"), "rb") as file:
            document = json.load(file)
            there.add(document.get("class"))
            needed.update(document.get("classes", ()))
    for name in sorted(needed - there):
        yield f"{folder}: there is no proof of the class {name!r}", False


def _has_proof(path: str) -> bool:
    return os.path.isfile(os.path.join(path, "proof.json"))


def _below(path: str) -> Iterator[str]:
    try:
        yield from (os.path.join(path, name) for name in sorted(os.listdir(path)))
    except NotADirectoryError:
        raise InputError(f"{path}: is a file; name the folder that it is in") from None
    except FileNotFoundError:
        return
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def _verdict(folder: str, files: Files | None) -> tuple[str, bool]:
    """One line about a folder, and whether its claim holds."""
    stopwatch = Stopwatch()
    stopwatch.stage = "verify"

    def read(name: str) -> bytes:
        return Path(folder, name).read_bytes()

    try:
        found = run(lambda: str(verify_tgospa.verify(read)), stopwatch, show=True)
        if files is not None:
            found += f"; the tables follow from the files{_check_tables(folder, files, stopwatch)}"
    except verify_tgospa.Wrong as error:
        return f"{folder}: {error}", False
    except verify_tgospa.DAMAGED as error:
        if isinstance(error, (ConfigError, InputError, MemoryError)):
            raise
        raise InputError(f"{folder}: no whole proof: {type(error).__name__}: {error}") from None
    return f"{folder}: {found}", True


def _check_tables(folder: str, files: Files, stopwatch: Stopwatch) -> str:
    """Whether tables and parameters follow from the files and the options that the proof records.

    Returns which rows are in them, in words; nothing if all are.

    Raises
    ------
    Wrong
        They do not.
    """
    with open(os.path.join(folder, "proof.json"), encoding="utf-8") as file:
        proof = json.load(file)
    if "options" not in proof:
        raise InputError(
            f"{folder}: does not say how the files were read, as it was saved from Python; name no "
            "files, or write it with --proof"
        )
    prepared = run(lambda: _prepared(files, proof, stopwatch), stopwatch, show=True)
    compared, parameters = prepared.compared, prepared.parameters
    options, proven = proof_parameters(compared, parameters), proof["parameters"]
    for name in sorted({*options, *proven}):
        if proven.get(name) != options.get(name):
            raise verify_tgospa.Wrong(
                f"the parameter {name} is {proven.get(name)!r}, must be {options.get(name)!r} by "
                "the recorded options"
            )
    made = proof_tables(compared, prepared.states.problem, parameters)
    for name, text in made.items():
        with open(os.path.join(folder, name), encoding="utf-8", newline="") as file:
            problem = difference(name, file.read(), text, parameters.cutoff)
        if problem:
            raise verify_tgospa.Wrong(
                f"{name} does not follow from {files[0]} and {files[1]} with the recorded "
                f"options: {problem}"
            )
    chosen = [
        f"--{name.strip('_').replace('_', '-')} {proof['options'][name]!r}"
        for name in ROW_OPTIONS
        if name in proof["options"]
    ]
    only = [f"class {proof['class']!r}"] if "class" in proof else []
    return "".join(f", {part}" for part in (*only, *chosen))


def _prepared(files: Files, proof: Mapping[str, Any], stopwatch: Stopwatch) -> Prepared:
    """What an evaluation of these files would solve."""
    options: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in proof["options"].items()
    }
    try:
        chosen = EvaluationOptions(**options)
    except TypeError as error:
        raise InputError(f"proof.json: options of another version: {error}") from None
    settings = make_settings(chosen, OutputOptions())
    sides = settings.read(*files)
    fitted, request = settings.fit(sides, files)
    if "class" in proof:
        truth, estimate = (side.of_class(proof["class"]) for side in sides)
        fitted = fit(truth, estimate, replace(request, distance=fitted.distance))
    return prepare(fitted, request, stopwatch=stopwatch)
