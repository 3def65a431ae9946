"""``tgospa-eval compare TRUTH ESTIMATE...``: solvers, or estimates, side by side."""

from functools import partial
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from tgospa_eval.cli.shared.help import Option, Verb
from tgospa_eval.cli.shared.option import KEYS, option
from tgospa_eval.cli.shared.options import CONFIG_FILE, EVALUATION, FORMATS, QUIET
from tgospa_eval.cli.simulate.command import SCENARIOS
from tgospa_eval.errors import ExitStatus

if TYPE_CHECKING:
    from tgospa_eval.cli.compare.values import CompareOptions

ELSEWHERE = {"solver", "epsilon", "by", "seed"}  # by: hidden, for it may come from a settings file
"""Options of everything that evaluates that this verb has not, or in another form."""

OF_STUDIES = {"targets", "steps", "runs", "scenario", "area", "seed"}
OF_FILES = {
    "against", "columns", "time_tolerance", "grid", "on_duplicate", "decimal", "max_input",
    "truth_format", "estimate_format", "truth_columns", "estimate_columns", "time", "class_",
    "truth_class", "estimate_class", "region", "unit", "by",
}  # fmt: skip
"""Parameters that mean nothing in the other case."""

SHARED = [add for add in EVALUATION if KEYS[add][0] not in ELSEWHERE]
_comparison = partial(click.option, cls=Option, section="Comparison")
_study = partial(click.option, cls=Option, section="Scaling study", show_default=True)
# Those of this verb alone are not read from settings files, which are those of all verbs.
OWN = (
    _comparison(
        "--solvers", metavar="NAMES",
        show_default="all, exact only where it is quick; for a ranking certified",
        help="Solvers to compare, with commas: certified, exact, sinkhorn. For a ranking the one "
        "to use.",
    ),
    option(
        "--epsilon", section="Comparison", metavar="NUMBERS", default="0.1,0.05,0.03,0.01",
        help="Temperatures of sinkhorn, as fractions of c^p, with commas: one run for each. For a "
        "ranking a single one, 0.03 by default.",
    ),
    _comparison(
        "--against", type=click.Choice(("per-step-gospa",)), metavar="per-step-gospa",
        help="Show per-step GOSPA beside TGOSPA: its sum, and with switches charged afterwards.",
    ),
    _study(
        "--simulate", is_flag=True,
        help="Compare solvers on simulated scenes of growing size; no files are read.",
    ),
    _study(
        "--targets", metavar="NUMBERS", default="10,20,50",
        help="Numbers of targets, with commas.",
    ),
    _study(
        "--steps", metavar="NUMBERS", default="50,100",
        help="Numbers of time steps, with commas; each with each number of targets.",
    ),
    _study(
        "--runs", type=click.IntRange(min=1), metavar="N", default=10,
        help="Number of scenes of each size.",
    ),
    _study(
        "--scenario", default="dense", type=click.Choice(SCENARIOS), metavar="NAME",
        help="What the targets do: crossing, parallel, convoy, dense, births or manoeuvring.",
    ),
    _study(
        "--area", type=float, metavar="LENGTH", default=100.0,
        help="Side of the square in which it happens; the noise is area / 200.",
    ),
    _study(
        "--seed", type=click.IntRange(min=0), metavar="N", default=0,
        help="Seed: the same one makes the same scenes.",
    ),
    option(
        "--format", "format_", section="Output", type=click.Choice(FORMATS), metavar="FORMAT",
        default="table", help="What to print: table, json, csv, markdown or latex.",
    ),
    option(
        "-o", "--output", section="Output", metavar="DIR", type=click.Path(readable=False),
        help="Write compare.json, CSV tables and pictures to this folder. A scaling study also "
        "writes report.md, and each run as soon as it is done.",
    ),
    option("--by", section="Filters", type=click.Choice(("class",)), hidden=True),
    option(
        "--force", section="Output", is_flag=True,
        help="Write into a folder with other files in it.",
    ),
    CONFIG_FILE,
    QUIET,
)  # fmt: skip


def _options(command: Any) -> Any:
    for add in reversed((*OWN[:10], *SHARED, *OWN[10:])):
        command = add(command)
    return command


@click.command("compare", cls=Verb)
@click.argument("files", metavar="TRUTH ESTIMATE...", type=click.Path(readable=False), nargs=-1)
@_options
@click.pass_context
def command(ctx: click.Context, /, files: tuple[str, ...], **options: Any) -> None:
    """Rank several estimates of a truth, or compare solvers on one estimate.

    Two files, TRUTH ESTIMATE, are a comparison of solvers: bounds, errors, time and
    memory. Three or more, TRUTH A B, are a ranking: which estimate is proven to be
    better, and by what. With a * in quotes files stand for several runs.

    \b
    Examples:
      tgospa-eval compare truth.csv a.csv b.csv c.csv             a ranking
      tgospa-eval compare 'run*/truth.csv' 'run*/a.csv' 'run*/b.csv'
      tgospa-eval compare truth.csv a.csv                         solvers
      tgospa-eval compare truth.csv a.csv --against per-step-gospa
      tgospa-eval compare --simulate -o study                     scaling study

    Exit status: 0 done, 2 wrong option, 3 bad input, 4 accuracy not reached, or
    proven bounds contradict each other.
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
        raise click.UsageError(
            "files are missing; type tgospa-eval compare TRUTH A B to rank estimates, "
            "TRUTH ESTIMATE to compare solvers, or --simulate for a scaling study"
        )
    from tgospa_eval.cli.compare.values import CompareOptions, StudyOptions

    if "epsilon" not in given:
        options["epsilon"] = None  # which depends on what is compared
    chosen = CompareOptions.of(options)
    if options["simulate"]:
        from tgospa_eval.cli.compare.study import study_sizes

        fine = study_sizes(chosen, StudyOptions.of(options))
    else:
        if by and not options["quiet"]:
            from tgospa_eval.cli.shared.streams import say

            say("by = class of the settings is left aside: compare takes all rows together")
        fine = _compare(files, chosen)
    ctx.exit(ExitStatus.DONE if fine else ExitStatus.NOT_REACHED)


def _compare(files: tuple[str, ...], options: "CompareOptions") -> bool:
    """A ranking, or solvers on one pair; whether all did what was asked, and agree."""
    from tgospa_eval.cli.compare.files import is_pattern

    if len(files) > 2 or options.per_step or any(map(is_pattern, files)):
        from tgospa_eval.cli.compare.ranking import compare_estimates

        return compare_estimates(files[0], files[1:], options)
    from tgospa_eval.cli.compare.solvers import compare_files

    return compare_files(files[0], files[1], options)
