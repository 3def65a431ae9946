"""``tgospa-eval verify FOLDER [TRUTH ESTIMATE]``: check of a proof folder in exact integers."""

import inspect
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import click

from tgospa_eval.api.options import OPTION_SPECS, names_file
from tgospa_eval.cli.shared.command import PATH, Option, Verb
from tgospa_eval.errors import ConfigError, ExitStatus, InputError

if TYPE_CHECKING:
    from tgospa_eval.common.progress import Stopwatch
    from tgospa_eval.evaluation.prepare import PreparedPair
    from tgospa_eval.proof.check import Claim
    from tgospa_eval.proof.verify_tgospa import Folder

Files = tuple[str, str]

NOT_OF_THE_TABLES = (
    *("cutoff", "order", "switch_penalty", "rho", "distance", "unit"),
    *("solver", "gap", "epsilon", "time_limit", "no_gating"),
)
"""Options of the metric and of the solver. The output does not name them.

Neither does it name the options of distances in `verify_tgospa.EXTRAS`. All other options of a
proof say how files are read, and are named in the output."""


NAMED = ("ignore_regions", "region", "covariance", "inner_cov")
"""Options of a proof that can name a file. The file is read only if the command line names it."""


@click.command(
    "verify",
    cls=Verb,
    params=[
        *(
            Option(
                f"--{OPTION_SPECS[name].key} FILE",
                f"With TRUTH ESTIMATE: your copy of the file of --{OPTION_SPECS[name].key}.",
                section="Files",
                type=PATH,
            )
            for name in NAMED
        ),
        Option(
            "--script",
            "Print the program that checks proofs, to read it or to archive it with a paper. It is "
            "one file that needs only Python.",
            section="Output",
        ),
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
    **named: str | None,
) -> None:
    """Check the proof in FOLDER, which evaluate --proof has written.

    Both bounds are computed again, in exact integers, from the tables, the assignment
    and the prices in FOLDER. The program that does so is a single file, which shares
    nothing with the solver. If the original files TRUTH and ESTIMATE are given, the
    tables and digests are also checked against them. A file that only the proof names
    is not opened.

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
    given = {name: path for name, path in named.items() if path is not None}
    if given and truth is None:
        raise click.UsageError(
            f"--{OPTION_SPECS[min(given)].key} needs TRUTH and ESTIMATE: name both files"
        )
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
            how = _check_tables(path, files, given, stopwatch)
            return f"; the tables follow from the files{how}"

        return run(lambda: check(path, proof, follows), stopwatch, show=True)

    proofs = check_folders(folder, judge)
    for claim in proofs.claims:
        (emit if claim.holds else print_notice)(f"{claim}\n" if claim.holds else str(claim))
    ctx.exit(ExitStatus.DONE if proofs.holds else ExitStatus.NOT_PROVEN)


def _check_tables(
    folder: str, files: Files, given: Mapping[str, str], stopwatch: "Stopwatch"
) -> str:
    """Check that the tables of a proof follow from the files and from the options in the proof.

    Return the class and the options of reading as a text. It is empty, or begins with a comma.

    Raises
    ------
    Wrong
        Tables, parameters, digests or the evaluated steps differ.
    """
    from tgospa_eval.proof import verify_tgospa
    from tgospa_eval.proof.write import check_provable, difference, proof_parameters, proof_tables

    there = verify_tgospa.Folder(folder)
    proof = there.proof()
    if "options" not in proof:
        raise InputError(
            f"{folder}: does not record how the files were read, as it was saved from Python; "
            "leave out TRUTH and ESTIMATE, or write the proof with --proof"
        )
    options = _options(folder, proof["options"], given)
    try:
        prepared, classes = _prepared(files, proof, options, stopwatch)
        compared, parameters = prepared.compared, prepared.parameters
        check_provable(compared, parameters)
    except ConfigError as error:  # a wrong option in the proof is an error of its file
        raise InputError(f"{folder}: proof.json, options: {error}") from None
    problem = prepared.states.problem
    for name, proven, must in _differing(
        proof["parameters"], proof_parameters(compared, parameters, problem)
    ):
        raise verify_tgospa.Wrong(
            f"the parameter {name} is {proven!r}, must be {must!r} by the recorded options"
        )
    for name, text in proof_tables(compared, problem, parameters).items():
        mismatch = difference(name, there.text(name), text, parameters.cutoff)
        if mismatch:
            raise verify_tgospa.Wrong(
                f"{name} does not follow from {files[0]} and {files[1]} with the recorded "
                f"options: {mismatch}"
            )
    inputs, evaluated_on = prepared.recorded()
    digests = {side: record["sha256"] for side, record in inputs.items()}
    recorded = {side: record["sha256"] for side, record in proof.get("inputs", {}).items()}
    stated = proof.get("classes", [])
    if stated != classes or (proof.get("class") not in classes if classes else "class" in proof):
        raise verify_tgospa.Wrong(
            f"class, classes: are {proof.get('class')!r} of {stated!r}, must be of {classes!r} by "
            f"{files[0]} and {files[1]}"
        )
    for part, claimed, recomputed in (
        ("judged", proof.get("judged"), evaluated_on.record()),
        ("inputs, sha256", recorded or None, digests),
    ):
        for name, proven, must in () if claimed is None else _differing(claimed, recomputed):
            raise verify_tgospa.Wrong(
                f"{part}, {name}: is {proven!r}, must be {must!r} by {files[0]} and {files[1]}"
            )
    known = {*NOT_OF_THE_TABLES, *" ".join(verify_tgospa.EXTRAS.values()).split()}
    chosen = [
        f"--{name.strip('_').replace('_', '-')} {value!r}"
        for name, value in options.items()
        if name not in known
    ]
    only = [f"class {proof['class']!r}"] if "class" in proof else []
    return "".join(f", {part}" for part in (*only, *chosen))


def _differing(
    proven: Mapping[str, object], must: Mapping[str, object]
) -> Iterator[tuple[str, object, object]]:
    """Yield the name and both values of each field that differs."""
    for name in sorted({*proven, *must}):
        if proven.get(name) != must.get(name):
            yield name, proven.get(name), must.get(name)


def _options(folder: str, recorded: Mapping[str, Any], given: Mapping[str, str]) -> dict[str, Any]:
    """Return the options of a proof, with the files that the command line names for them.

    Raises
    ------
    InputError
        The proof names a file for an option, but the command line does not. The file that the proof
        names is not opened.
    UsageError
        The command line names a file for an option that the proof does not have.
    """
    options = dict(recorded)
    for name, value in recorded.items():
        if names_file(name, value) and name not in given:
            yours = (
                f"; name your copy with --{OPTION_SPECS[name].key} FILE" if name in NAMED else ""
            )
            raise InputError(
                f"{folder}: proof.json, options, {name}: names a file, {value!r:.80}, which is "
                f"not opened automatically{yours}"
            )
    for name, path in given.items():
        if name not in recorded or not names_file(name, recorded[name]):
            raise click.UsageError(
                f"--{OPTION_SPECS[name].key}: the proof was written without this option; leave it "
                "out"
            )
        options[name] = path
    return options


def _prepared(
    files: Files, proof: Mapping[str, Any], options: Mapping[str, Any], stopwatch: "Stopwatch"
) -> "tuple[PreparedPair, list[str]]":
    """Return the problem of these files with `options`, and the names of their classes."""
    from tgospa_eval.api.keywords import requested
    from tgospa_eval.api.reading import align_sides, read_pair
    from tgospa_eval.api.resolve import resolve_request
    from tgospa_eval.evaluation.prepare import fit, prepare
    from tgospa_eval.formats.reading import classes_in

    resolved = resolve_request(
        requested(
            {
                name: tuple(value) if isinstance(value, list) else value
                for name, value in options.items()
            }
        )
    )
    sides = read_pair(resolved, *files)
    fitted, request = align_sides(resolved, sides, files)
    if "class" in proof:
        truth, estimate = (side.of_class(proof["class"]) for side in sides)
        fitted = fit(truth, estimate, fitted.of_parts(request))
    classes = classes_in(sides) if resolved.reading.by_class else []
    return prepare(fitted, request, stopwatch=stopwatch), classes
