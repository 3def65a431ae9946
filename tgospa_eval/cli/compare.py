"""``tgospa-eval compare TRUTH ESTIMATE...``: solvers, or estimates, side by side."""

from typing import Any

import click
from click.core import ParameterSource

from tgospa_eval.cli.options import CONFIG_FILE, EVALUATION, FORMATS, KEYS, QUIET, option
from tgospa_eval.cli.simulate import SCENARIOS

ACCURACY_MISSED = 4
ELSEWHERE = {"solver", "epsilon", "by", "seed"}  # by: hidden, for it may come from a settings file
"""Options of everything that evaluates that this verb has not, or in another form."""

OF_STUDIES = {"targets", "steps", "runs", "scenario", "area", "seed"}
OF_FILES = {
    "against", "columns", "time_tolerance", "grid", "on_duplicate", "decimal", "truth_format",
    "estimate_format", "time", "class_", "region", "unit",
    "by",
}  # fmt: skip
"""Parameters that mean nothing in the other case."""

SHARED = [add for add in EVALUATION if KEYS[add][0] not in ELSEWHERE]
OWN = (
    # Those of this verb alone are not read from settings files, which are those of all verbs.
    click.option(
        "--solvers", metavar="NAMES",
        help="Of certified, exact, sinkhorn.  [default: all, exact only where it is quick; "
        "of several estimates certified]",
    ),
    option(
        "--epsilon", metavar="NUMBERS", default="0.1,0.05,0.03,0.01",
        help="Temperatures of sinkhorn, fractions of c^p; one run each.",
    ),
    click.option(
        "--against", type=click.Choice(("per-step-gospa",)),
        help="Beside TGOSPA: per-step GOSPA, summed, and with switches charged afterwards.",
    ),
    click.option("--simulate", is_flag=True, help="Scaling study on made-up scenes; no files."),
    click.option(
        "--targets", metavar="NUMBERS", default="10,20,50", show_default=True,
        help="Of a study: numbers of targets.",
    ),
    click.option(
        "--steps", metavar="NUMBERS", default="50,100", show_default=True,
        help="Of a study: numbers of steps, each with each of --targets.",
    ),
    click.option(
        "--runs", type=click.IntRange(min=1), default=10, show_default=True,
        help="Of a study: scenes of each size.",
    ),
    click.option(
        "--scenario", default="dense", show_default=True, type=click.Choice(SCENARIOS),
        help="Of a study: what the targets do.",
    ),
    click.option(
        "--area", type=float, default=100.0, show_default=True,
        help="Of a study: side of the square in which it happens; the noise is area / 200.",
    ),
    click.option(
        "--seed", type=click.IntRange(min=0), default=0, show_default=True,
        help="Of a study: the same seed makes the same scenes.",
    ),
    option(
        "--format", "format_", type=click.Choice(FORMATS), default="table",
        help="What to print.",
    ),
    option(
        "-o", "--output", metavar="DIR", type=click.Path(),
        help="Write compare.json, CSV tables and, with the extra plot, pictures to this folder; "
        "of a study report.md too, and every run as soon as it is done.",
    ),
    option("--by", type=click.Choice(("class",)), hidden=True),
    option("--force", is_flag=True, help="Write into a folder with other files in it."),
    CONFIG_FILE,
    QUIET,
)  # fmt: skip


def _options(command: Any) -> Any:
    for add in reversed((*OWN[:10], *SHARED, *OWN[10:])):
        command = add(command)
    return command


@click.command("compare", context_settings={"max_content_width": 80})
@click.argument("files", metavar="TRUTH ESTIMATE...", type=click.Path(), nargs=-1)
@_options
@click.pass_context
def command(ctx: click.Context, /, files: tuple[str, ...], **options: Any) -> None:
    """Solve one problem with several solvers, or rank several estimates of a truth.

    \b
    compare TRUTH ESTIMATE        solvers and settings: bounds, errors, time, memory
    compare TRUTH A B C           ranking with proven order, paired differences
    compare 'mc/*/gt.csv' 'mc/*/a.csv' 'mc/*/b.csv'
                                  the same over the runs that * stands for
    compare --simulate            scaling study on made-up scenes

    Exit status: 0 done, 2 wrong option, 3 bad input file, 4 brackets contradict
    each other, or accuracy not reached.
    """
    source = {name: ctx.get_parameter_source(name) for name in ctx.params}
    given = {name for name, where in source.items() if where is not ParameterSource.DEFAULT}
    typed = {name for name, where in source.items() if where is ParameterSource.COMMANDLINE}
    wrong = sorted(typed & (OF_FILES if options["simulate"] else OF_STUDIES))
    if wrong:
        name = "--" + wrong[0].removesuffix("_").replace("_", "-")
        raise click.UsageError(
            f"{name} is for files, not for --simulate" if options["simulate"]
            else f"{name} is for --simulate"
        )  # fmt: skip
    if "by" in typed:
        raise click.UsageError(
            "--by class: compare takes all rows together; choose one class by --class NAME"
        )
    by = options.pop("by")
    if options["simulate"] and files:
        raise click.UsageError(f"--simulate makes its scenes; {files[0]}: no files are read")
    if not options["simulate"] and len(files) < 2:
        raise click.UsageError("two files or more are needed, TRUTH ESTIMATE..., or --simulate")
    from tgospa_eval.cli import comparing
    from tgospa_eval.cli.work import say  # here: what is wrong is said at once

    if by and not options["simulate"] and not options["quiet"]:
        say("by = class of the settings is left aside: compare takes all rows together")
    if options["simulate"]:
        fine = comparing.study_sizes(options, given)
    elif len(files) > 2 or options["against"] or any(map(comparing.is_pattern, files)):
        fine = comparing.compare_estimates(files[0], files[1:], options, given)
    else:
        fine = comparing.compare_files(files[0], files[1], options, given)
    ctx.exit(0 if fine else ACCURACY_MISSED)
