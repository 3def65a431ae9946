"""``--explain``, and what the verb `explain` does with a result: its repairs, tried and proven."""

from dataclasses import replace

from tgospa_eval.api.request import Request
from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.cli.shared.values import OutputOptions
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.explain.explain import TOP, explain
from tgospa_eval.results.explanation import Explanation
from tgospa_eval.results.records import Json
from tgospa_eval.results.result import Result
from tgospa_eval.results.summary import Summary


def explained(
    result: Summary, options: Request, output: OutputOptions, top: int = TOP
) -> Explanation:
    """The repairs of an estimate that was read from a file, `top` of them at most.

    Parameters
    ----------
    result : Summary
        Of all classes together.
    options : Request
        Filters, after which some kinds of repairs are not tried.
    output : OutputOptions
        Whether progress is shown, and seconds.
    top : int
        How many to list.
    """
    assert isinstance(result, Result)  # --by class is refused
    stopwatch = Stopwatch()
    found = run(
        lambda: explain(result, top, stopwatch=stopwatch, without=_left_out(options)),
        stopwatch,
        show=not output.quiet,
    )
    if output.verbose:
        print_notice(f"{'explain':<20} {found.seconds:9.3f} s")
    return found


def with_repairs(result: Summary, options: Request, output: OutputOptions) -> Summary:
    """The result with its repairs, for every output; the time that they took counts."""
    found = explained(result, options, output)
    total = result.timings["total"] + found.seconds
    timings: Json = {**result.timings, "explain": found.seconds, "total": total}
    return replace(result, explained=found, timings=timings)


def _left_out(options: Request) -> tuple[str, ...]:
    """Kinds of repairs after which a filter might leave out other rows."""
    moving = ("shift",) if options.time else ()
    return (*moving, "offset", "extend") if options.region else moving
