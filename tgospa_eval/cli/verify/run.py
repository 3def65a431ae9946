"""Check proof folders, and that their tables follow from the files they came from."""

import inspect
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from tgospa_eval.api.request import Request
from tgospa_eval.api.settings import make_settings
from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.streams import emit, print_notice
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.distances.base import DistanceSettings
from tgospa_eval.errors import InputError
from tgospa_eval.evaluation.prepare import Prepared, fit, prepare
from tgospa_eval.proof import verify_tgospa
from tgospa_eval.proof.check import Claim, check, check_folders
from tgospa_eval.proof.write import check_provable, difference, proof_parameters, proof_tables

Files = tuple[str, str]

NOT_OF_THE_TABLES = (
    *("cutoff", "order", "switch_penalty", "rho", "distance", *DistanceSettings.__annotations__),
    *("unit", "solver", "gap", "epsilon", "time_limit", "no_gating"),
)
"""Options of the metric, which a verdict has as parameters, and of the solver. All others that a
proof records say what was read of the files, and how: a verdict names them."""


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

    def judge(path: str, proof: verify_tgospa.Folder) -> Claim:
        stopwatch = Stopwatch()
        stopwatch.stage = "verify"

        def follows() -> str:
            if files is None:
                return ""
            return f"; the tables follow from the files{_check_tables(path, files, stopwatch)}"

        return run(lambda: check(path, proof, follows), stopwatch, show=True)

    found = check_folders(folder, judge)
    for claim in found.claims:
        (emit if claim.holds else print_notice)(f"{claim}\n" if claim.holds else str(claim))
    return found.holds


def _check_tables(folder: str, files: Files, stopwatch: Stopwatch) -> str:
    """Whether tables and parameters follow from the files and the options that the proof records.

    Returns how the files were read, in words; nothing if as they are.

    Raises
    ------
    Wrong
        They do not.
    """
    proof = verify_tgospa.Folder(folder).proof()
    if "options" not in proof:
        raise InputError(
            f"{folder}: does not say how the files were read, as it was saved from Python; name no "
            "files, or write it with --proof"
        )
    prepared = _prepared(files, proof, stopwatch)
    compared, parameters = prepared.compared, prepared.parameters
    check_provable(compared, parameters)
    options, proven = proof_parameters(compared, parameters), proof["parameters"]
    for name in sorted({*options, *proven}):
        if proven.get(name) != options.get(name):
            raise verify_tgospa.Wrong(
                f"the parameter {name} is {proven.get(name)!r}, must be {options.get(name)!r} by "
                "the recorded options"
            )
    made = proof_tables(compared, prepared.states.problem, parameters)
    for name, text in made.items():
        there = Path(folder, name).read_bytes().decode()
        problem = difference(name, there, text, parameters.cutoff)
        if problem:
            raise verify_tgospa.Wrong(
                f"{name} does not follow from {files[0]} and {files[1]} with the recorded "
                f"options: {problem}"
            )
    chosen = [
        f"--{name.strip('_').replace('_', '-')} {value!r}"
        for name, value in proof["options"].items()
        if name not in NOT_OF_THE_TABLES
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
        chosen = Request(**options)
    except TypeError as error:
        raise InputError(f"proof.json: options of another version: {error}") from None
    settings = make_settings(chosen)
    sides = settings.read(*files)
    fitted, request = settings.fit(sides, files)
    if "class" in proof:
        truth, estimate = (side.of_class(proof["class"]) for side in sides)
        fitted = fit(truth, estimate, replace(request, distance=fitted.distance))
    return prepare(fitted, request, stopwatch=stopwatch)
