"""``tgospa-eval [evaluate] TRUTH ESTIMATE``: one evaluation, printed and optionally written."""

from collections.abc import Iterator
from typing import NoReturn

import click

from tgospa_eval.api.options import DEFAULTS, FITTING, Request
from tgospa_eval.cli.shared import click_builder
from tgospa_eval.cli.shared.command import SOURCE, Option, Verb, typed_options, words
from tgospa_eval.errors import ExitStatus, MemoryTooSmallError

FOR_PARTS = (
    "--scheduler is for data in parts: folders of tables, or files larger than --memory; for many "
    "evaluations: tgospa-eval batch"
)
MANY = 8
"""Number of additional files. A message lists them only if they are fewer than this."""


class Files(Verb):
    """Command that proposes another verb if it gets only one file, or more than two."""

    def _too_few(self, ctx: click.Context, missing: click.Argument) -> str:
        text, truth = super()._too_few(ctx, missing), ctx.params.get("truth")
        return (
            f"{text}; for one file alone: tgospa-eval inspect {words([truth])}" if truth else text
        )

    def _too_many(self, ctx: click.Context, rest: list[str]) -> str:
        text, given = super()._too_many(ctx, rest), (ctx.params["truth"], ctx.params["estimate"])
        files = words((*given, *rest)) if len(rest) < MANY else "TRUTH A B"
        return f"{text}; to rank estimates: tgospa-eval compare {files}"


@click.command(
    "evaluate",
    cls=Files,
    params=[
        # These options are declared as fields of `Request` in api/options.py.
        *click_builder.EVALUATION,
        *click_builder.IN_PARTS_OPTIONS,
        *click_builder.OUTPUT,
        click_builder.WITH,
        click_builder.SLICE,
        Option(
            "--sweep NAME=VALUES",
            "Evaluate for each value of c, p, gamma or rho: c=2,5,10, or gamma=1:20:12 for 12 "
            "values from 1 to 20. gamma=1:20:12:log makes their ratios equal.",
            section="Output",
            multiple=True,
        ),
        Option(
            "--proof",
            "With -o, write the folder proof as well, from which anybody can check the value: "
            "tgospa-eval verify DIR.",
            section="Output",
        ),
        Option(
            "--geojson",
            "With -o, write result.geojson as well: tracks, misses, false targets, errors and "
            "switches with times and costs, for maps. The states must be places on the Earth.",
            section="Output",
        ),
        *(
            click_builder.OPTIONS[key]
            for key in ("curve", "window", "every", "similarity", "tracked-shares", "explain")
        ),
    ],
)
@click.argument("truth", type=SOURCE)
@click.argument("estimate", type=SOURCE)
@click.pass_context
def command(
    ctx: click.Context, /, truth: str, estimate: str, sweep: tuple[str, ...], **options: object
) -> None:
    """Evaluate ESTIMATE against TRUTH with the TGOSPA metric.

    Both are tables with the columns id,t,x[,y[,z]] and one row per object and time
    step (CSV or Parquet), or MOTChallenge or KITTI text. An object without a row at
    a step does not exist at that step. A folder of such tables is one recording in parts,
    of any size.

    \b
    Examples:
      tgospa-eval truth.csv estimate.csv -c 10 -g 5 --unit m
      tgospa-eval truth.csv estimate.csv -o results --explain
      tgospa-eval truth.csv estimate.csv --columns id=track,t=time_s,x=px,y=py
      tgospa-eval truth.csv estimate.csv --sweep gamma=1,2,5,10
      tgospa-eval gt.txt results.txt --distance iou --with hota,clear,identity
      tgospa-eval truth.csv estimate.csv --slice range=0:50:100 --slice class
      tgospa-eval truth/ estimate/ --memory 4GB -o results

    Exit status: 0 done, 2 wrong option, 3 bad input, 4 accuracy not reached.
    """
    chosen, output = Request.of(options), click_builder.OutputOptions.of(options)
    given = typed_options(ctx)
    _check(chosen, output, given, sweep=bool(sweep))
    from tgospa_eval.api.in_parts import can_be_divided, check_parts, parts_in_words
    from tgospa_eval.cli.evaluate.run import evaluate_files, show

    def in_parts(why: str) -> NoReturn:
        from tgospa_eval.cli.evaluate.partitioned import evaluate_parts

        more_options = {
            "proof": output.proof and FITTING,
            "geojson": output.geojson and FITTING,
            "plane": output.plane and "leave it out: there is no picture of trajectories",
            "sweep": sweep and "evaluate for one value after the other",
        }
        check_parts(chosen, why, ((name, text) for name, text in more_options.items() if text))
        finished = evaluate_parts((truth, estimate), chosen, output, why)
        ctx.exit(ExitStatus.DONE if finished else ExitStatus.NOT_REACHED)

    why = parts_in_words((truth, estimate), chosen, pictures=output.output is not None)
    if why is not None:
        in_parts(why)
    if chosen.scheduler is not None:
        raise click.UsageError(FOR_PARTS)
    if sweep:
        from tgospa_eval.cli.evaluate.sweep import sweep_files

        finished = sweep_files((truth, estimate), sweep, chosen, output, given)
        ctx.exit(ExitStatus.DONE if finished else ExitStatus.NOT_REACHED)
    try:
        result, finished = evaluate_files(truth, estimate, chosen, output)
    except MemoryTooSmallError as error:
        if not can_be_divided((truth, estimate)):
            raise
        in_parts(error.reason)
    if chosen.explain:
        from tgospa_eval.cli.evaluate.run import with_repairs

        result = with_repairs(result, output)
    show(result, chosen, output, (truth, estimate))
    ctx.exit(ExitStatus.DONE if finished else ExitStatus.NOT_REACHED)


def _check(
    chosen: Request, output: click_builder.OutputOptions, typed: set[str], *, sweep: bool
) -> None:
    """Check that the options can be combined; `typed` names those of the command line.

    Raises
    ------
    UsageError
        Two options exclude each other, or an option needs another one.
    """
    for name in click_builder.OF_PICTURES if output.output is None else ():
        if name in typed and not (name == "pictures" and output.pictures == "none"):
            raise click.UsageError(f"--{name} needs -o DIR, the folder of the pictures")
    for name in ("proof", "geojson"):
        if name in typed and (sweep or output.output is None):
            raise click.UsageError(
                f"--{name} {'is not supported with --sweep' if sweep else 'needs -o DIR'}"
            )
    for option in _without_proof(chosen) if "proof" in typed else ():
        raise click.UsageError(f"--proof is not supported with {option}: leave one of them out")
    shares = chosen.tracked_shares != DEFAULTS["tracked_shares"]
    of_one = {
        "format methods": output.format_ == "methods",
        "slice": chosen.slices,
        "with": chosen.with_ is not None,
        "similarity": chosen.similarity is not None,
        "tracked-shares": shares,
        "explain": chosen.explain,
    }
    for name in (name for name, is_given in of_one.items() if sweep and is_given):
        raise click.UsageError(
            f"--{name} is not supported with --sweep: leave one of the two options out"
        )
    if chosen.explain and chosen.by:
        raise click.UsageError(
            "--explain cannot be combined with --by class, because it evaluates all classes "
            "together; choose one class by --class NAME"
        )
    if chosen.explain and chosen.preprocess:
        raise click.UsageError(
            "--explain cannot be combined with --preprocess, because what --preprocess leaves out "
            "depends on the repair"
        )


def _without_proof(chosen: Request) -> Iterator[str]:
    from tgospa_eval.proof.verify_tgospa import EXTRAS  # lazy: few evaluations write proofs

    if chosen.existence == "use":
        yield "--existence use"
    if chosen.step_weights is not None:
        yield "--step-weights"
    if chosen.distance not in (None, *EXTRAS):
        yield f"--distance {chosen.distance}"
