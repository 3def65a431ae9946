"""``tgospa-eval compare TRUTH ESTIMATE...``: comparison of estimates or of solvers."""

from functools import partial
from typing import Any

import click
from click.core import ParameterSource

from tgospa_eval.api.options import Request
from tgospa_eval.cli.shared import click_builder
from tgospa_eval.cli.shared.command import PATH, SOURCE, Option, Verb, dashed, option, typed_options
from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.cli.simulate import SCENARIOS
from tgospa_eval.errors import ExitStatus

ELSEWHERE = {"solver", "epsilon", "by", "seed", "steps"}
"""Options of evaluations that this verb lacks or has in another form. Here, ``by`` is a hidden
option: if a settings file has it, a notice says that it is ignored."""

OF_STUDIES = {"targets", "runs", "scenario", "area", "seed"}
SHARED = [item for item in click_builder.EVALUATION if item.key not in ELSEWHERE]
OF_FILES = {"against", "unit", "by", "with_", "columns_of_table"} | {
    str(item.name) for item in SHARED if item.section in ("Files", "Filters")
}
"""Names of parameters that do not apply to ``--simulate``."""

OF_RESULTS = {
    *("files", "format_", "columns_of_table", "output", "force", "config", "quiet"),
    *("pictures", "style"),
}
"""Names of all parameters that apply to a ranking of saved results."""

_comparison = partial(Option, section="Comparison")
_study = partial(Option, section="Scaling study")
# All verbs share a settings file. It cannot set the following options, which only this verb has.
COMPARE_OPTIONS = (
    _comparison(
        "--solvers NAMES",
        "Solvers to compare, with commas: certified, exact, sinkhorn. For a ranking: the solver "
        "to use.",
        show_default="all, but exact only if it is quick; for a ranking certified",
    ),
    option(
        "--epsilon NUMBERS",
        "Temperatures of sinkhorn, as fractions of c^p, with commas: one run for each. For a "
        "ranking a single one, 0.03 by default.",
        section="Comparison",
        default="0.1,0.05,0.03,0.01",
    ),
    _comparison(
        "--against per-step-gospa",
        "Also show the sum of per-step GOSPA, without and with the cost of its switches.",
        type=click.Choice(("per-step-gospa",)),
    ),
    _study("--simulate", "Compare solvers on simulated scenes of growing size; no files are read."),
    _study("--targets NUMBERS", "Numbers of targets, with commas.", default="10,20,50"),
    _study(
        "--steps NUMBERS",
        "Numbers of time steps, with commas; each is combined with each number of targets. With "
        "files, FIRST:LAST[:EVERY] names the steps to evaluate, as for evaluate.",
        show_default="50,100; all times of files",
    ),
    _study("--runs N", "Number of scenes of each size.", type=click.IntRange(min=1), default=10),
    _study(
        "--scenario NAME",
        "Motion of the targets: crossing, parallel, convoy, dense, births or manoeuvring.",
        default="dense",
        type=click.Choice(SCENARIOS),
    ),
    _study(
        "--area LENGTH",
        "Side of the square with the targets; the noise is area / 200.",
        type=float,
        default=100.0,
    ),
    _study(
        "--seed N",
        "Seed of the scenes; equal seeds give equal scenes.",
        type=click.IntRange(min=0),
        default=0,
    ),
)
COMPARE_OUTPUT = (
    click_builder.report_format(),
    option(
        "-o, --output DIR",
        "Write report.html, compare.json, CSV tables and pictures to this folder. A scaling study "
        "also writes report.md, and each run as soon as it is done.",
        section="Output",
        type=PATH,
    ),
    *click_builder.PICTURES,
    click_builder.WITH,
    click_builder.COLUMNS_OF_TABLE,
    click_builder.BY_OF_SETTINGS,
    click_builder.FORCE,
    click_builder.CONFIG_FILE,
    click_builder.QUIET,
)


class Compare(Verb):
    """Command that also ranks saved results."""

    def uses(self, ctx: click.Context, name: str) -> bool:
        """Return whether an option applies: to saved results, only those of results."""
        from tgospa_eval.api.compare import are_saved

        files = ctx.params["files"]
        return name in OF_RESULTS or not files or not are_saved(files)


@click.command("compare", cls=Compare, params=[*COMPARE_OPTIONS, *SHARED, *COMPARE_OUTPUT])
@click.argument("files", metavar="TRUTH ESTIMATE...", type=SOURCE, nargs=-1)
@click.pass_context
def command(
    ctx: click.Context, /, files: tuple[str, ...], simulate: bool, by: str | None, **options: object
) -> None:
    """Rank several estimates of a truth, or compare solvers on one estimate.

    Two files, TRUTH ESTIMATE, compare solvers: bounds, errors, time and memory.
    Three or more, TRUTH A B, are ranked: which estimate is proven to be better, and
    by what. A pattern in quotes stands for several files: * or a field such as {run}
    for several runs, a field that only estimates have for several estimates. Saved
    results (folders of -o, or their result.json) are ranked as they are.

    \b
    Examples:
      tgospa-eval compare truth.csv a.csv b.csv c.csv             a ranking
      tgospa-eval compare 'gt/{run}.csv' 'out/{tracker}/{run}.csv'
      tgospa-eval compare 'run*/truth.csv' 'run*/a.csv' 'run*/b.csv'
      tgospa-eval compare a/result.json b/result.json             saved results
      tgospa-eval compare truth.csv a.csv                         solvers
      tgospa-eval compare truth.csv a.csv --against per-step-gospa
      tgospa-eval compare truth.csv a.csv b.csv --with hota,identity
      tgospa-eval compare --simulate -o study                     scaling study

    Exit status: 0 done, 2 wrong option, 3 bad input, 4 accuracy not reached, or
    proven bounds contradict each other.
    """
    typed = typed_options(ctx)
    wrong = sorted(typed & (OF_FILES if simulate else OF_STUDIES))
    if wrong:
        about = "files, not for --simulate" if simulate else "--simulate"
        raise click.UsageError(f"{dashed(wrong[0])} is for {about}")
    if "by" in typed:
        raise click.UsageError(
            "--by class: compare evaluates all classes together; choose one class by --class NAME"
        )
    if simulate and files:
        raise click.UsageError(f"--simulate makes its own scenes; leave out {files[0]}")
    is_saved = not simulate and _are_saved(files, typed)
    if not simulate and not is_saved and len(files) < 2:
        raise click.UsageError(
            "files are missing; type tgospa-eval compare TRUTH A B to rank estimates, "
            "TRUTH ESTIMATE to compare solvers, or --simulate for a scaling study"
        )
    from tgospa_eval.campaign.pairs import is_pattern
    from tgospa_eval.cli.compare import run
    from tgospa_eval.show.study_table import checked_columns

    # These options have other types here than the fields of `Request` with the same names.
    separate = ("epsilon", "seed", *(("steps",) if simulate else ()))
    request = Request.of({name: value for name, value in options.items() if name not in separate})
    output: Any = click_builder.OutputOptions.of(options)
    checked_columns(output.columns_of_table)
    solvers: Any = options["solvers"]
    # The default of --epsilon depends on what is compared.
    has_default = ctx.get_parameter_source("epsilon") is ParameterSource.DEFAULT
    epsilon: Any = None if has_default else options["epsilon"]
    make = partial(run.make_solvers, request, solvers, epsilon)
    if simulate:
        sizes: Any = {name: options[name] for name in OF_STUDIES}
        sizes["steps"] = options["steps"] or "50,100"
        fine = run.study_sizes(request, output, make, **sizes)
    elif is_saved:
        fine = run.compare_saved(files, output)
    else:
        if by and not output.quiet:
            print_notice(
                "by = class in the settings is ignored: compare evaluates all classes together"
            )
        per_step = options["against"] is not None
        has_extras = per_step or request.with_ is not None or output.columns_of_table
        if len(files) > 2 or has_extras or any(map(is_pattern, files)):
            fine = run.compare_estimates(files, request, output, make, per_step=per_step)
        else:
            fine = run.compare_files(files, request, output, make, spare=solvers is None)
    ctx.exit(ExitStatus.DONE if fine else ExitStatus.NOT_REACHED)


def _are_saved(files: tuple[str, ...], typed: set[str]) -> bool:
    """Return whether the files are saved results; if so, check that all options apply to these."""
    from tgospa_eval.api.compare import are_saved

    if not files or not are_saved(files):
        return False
    wrong = sorted(typed - OF_RESULTS)
    if wrong:
        raise click.UsageError(
            f"{dashed(wrong[0])} needs the data, but {files[0]} is a saved result; name the files "
            "of truth and estimates instead"
        )
    return True
