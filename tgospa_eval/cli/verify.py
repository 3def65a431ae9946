"""``tgospa-eval verify FOLDER [TRUTH ESTIMATE]``: check a proof folder in exact integers."""

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tgospa_eval.cli.shared.command import PATH, Option, Verb
from tgospa_eval.errors import ExitStatus, InputError

if TYPE_CHECKING:
    from tgospa_eval.common.progress import Stopwatch
    from tgospa_eval.evaluation.prepare import Prepared
    from tgospa_eval.proof.check import Claim
    from tgospa_eval.proof.verify_tgospa import Folder

Files = tuple[str, str]

NOT_OF_THE_TABLES = (
    *("cutoff", "order", "switch_penalty", "rho", "distance", "unit"),
    *("solver", "gap", "epsilon", "time_limit", "no_gating"),
)
"""Options of the metric, which a verdict has as parameters, and of the solver, beside those of the
distance. All others that a proof records say what was read, and how: a verdict names them."""


@click.command(
    "verify",
    cls=Verb,
    params=[
        Option(
            "--script",
            "Print the program that checks, one file that needs Python alone: to read, and to "
            "archive with a paper.",
            section="Output",
        )
    ],
)
@click.argument("folder", type=PATH, required=False)
@click.argument("truth", type=PATH, required=False)
@click.argument("estimate", type=PATH, required=False)
@click.pass_context
def command(
    ctx: click.Context,
    /,
    folder: str | None,
    truth: str | None,
    estimate: str | None,
    *,
    script: bool,
) -> None:
    """Check the proof in FOLDER, which evaluate --proof has written.

    From the tables, the assignment and the prices in it both bounds are computed
    again, in exact integers, by a program of one file that shares nothing with the
    solver. With the original files TRUTH and ESTIMATE it is also checked that the
    tables follow from them.

    \b
    Examples:
      tgospa-eval verify results/proof
      tgospa-eval verify results/proof truth.csv estimate.csv
      tgospa-eval verify --script > verify_tgospa.py

    Exit status: 0 the claim holds, 1 it does not, 2 wrong option, 3 bad folder or file.
    """
    from tgospa_eval.cli.shared.progress import run
    from tgospa_eval.cli.shared.streams import emit, print_notice

    if script != (folder is None):
        raise click.UsageError(
            "--script takes no folder" if script else "name a proof folder, or --script"
        )
    if (truth is None) != (estimate is None):
        raise click.UsageError("name both files, TRUTH and ESTIMATE, or none")
    from tgospa_eval.common.progress import Stopwatch
    from tgospa_eval.proof import verify_tgospa
    from tgospa_eval.proof.check import check, check_folders

    if folder is None:
        emit(inspect.getsource(verify_tgospa))
        return
    files = None if truth is None or estimate is None else (truth, estimate)

    def judge(path: str, proof: "Folder") -> "Claim":
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
    ctx.exit(ExitStatus.DONE if found.holds else ExitStatus.NOT_PROVEN)


def _check_tables(folder: str, files: Files, stopwatch: "Stopwatch") -> str:
    """Whether tables and parameters follow from the files and the options that the proof records.

    Returns how the files were read, in words; nothing if as they are.

    Raises
    ------
    Wrong
        They do not.
    """
    from tgospa_eval.proof import verify_tgospa
    from tgospa_eval.proof.write import check_provable, difference, proof_parameters, proof_tables

    proof = verify_tgospa.Folder(folder).proof()
    if "options" not in proof:
        raise InputError(
            f"{folder}: does not say how the files were read, as it was saved from Python; name no "
            "files, or write it with --proof"
        )
    prepared = _prepared(files, proof, stopwatch)
    compared, parameters = prepared.compared, prepared.parameters
    check_provable(compared, parameters)
    options, proven = (
        proof_parameters(compared, parameters, prepared.states.problem),
        proof["parameters"],
    )
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
    known = {*NOT_OF_THE_TABLES, *" ".join(verify_tgospa.EXTRAS.values()).split()}
    chosen = [
        f"--{name.strip('_').replace('_', '-')} {value!r}"
        for name, value in proof["options"].items()
        if name not in known
    ]
    only = [f"class {proof['class']!r}"] if "class" in proof else []
    return "".join(f", {part}" for part in (*only, *chosen))


def _prepared(files: Files, proof: Mapping[str, Any], stopwatch: "Stopwatch") -> "Prepared":
    """What an evaluation of these files would solve."""
    from dataclasses import replace

    from tgospa_eval.api.options import Request
    from tgospa_eval.api.resolve import make_settings
    from tgospa_eval.evaluation.prepare import fit, prepare

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
