"""``tgospa-eval verify FOLDER [TRUTH ESTIMATE]``: check a proof folder in exact integers."""

import click

from tgospa_eval.cli.shared.help import Verb
from tgospa_eval.cli.shared.option import PATH, Option
from tgospa_eval.errors import ExitStatus


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
    from tgospa_eval.cli.shared.streams import emit
    from tgospa_eval.cli.verify.run import program, verify_folder

    if script != (folder is None):
        raise click.UsageError(
            "--script takes no folder" if script else "name a proof folder, or --script"
        )
    if (truth is None) != (estimate is None):
        raise click.UsageError("name both files, TRUTH and ESTIMATE, or none")
    if folder is None:
        emit(program())
        return
    files = None if truth is None or estimate is None else (truth, estimate)
    holds = verify_folder(folder, files)
    ctx.exit(ExitStatus.DONE if holds else ExitStatus.NOT_PROVEN)
