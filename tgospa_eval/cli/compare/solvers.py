"""``compare TRUTH ESTIMATE``: one pair of files through several solvers."""

from tgospa_eval.cli.compare.files import Pairs, check_files
from tgospa_eval.cli.compare.show import show
from tgospa_eval.cli.compare.values import CompareOptions
from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.comparison.runs import name_of, takes_long
from tgospa_eval.comparison.solvers import ONCE, compare_solvers, solvers_document
from tgospa_eval.plots.comparison import solver_pictures
from tgospa_eval.reports.records import SolversRecord
from tgospa_eval.solvers import SOLVERS


def compare_files(truth: str, estimate: str, options: CompareOptions) -> bool:
    """One pair through several solvers; whether all did what was asked, and agree.

    Raises
    ------
    TgospaError
        An option has no meaning, or a file cannot be read.
    """
    solvers = options.make_solvers(",".join(SOLVERS))
    check_files([truth, estimate])
    settings = options.checked_settings()
    stopwatch, quiet = Stopwatch(), options.output.quiet

    def work() -> SolversRecord:
        pairs = Pairs(settings, stopwatch, quiet=quiet)
        prepared = pairs.prepared(truth, estimate)
        chosen, left_out = list(solvers), {}
        states = takes_long(prepared)
        if options.solvers is None and states is not None:
            chosen = [solver for solver in solvers if not solver.referee]
            reason = f"{states:,} reduced states, it would take minutes; --solvers "
            reason += f"{','.join(SOLVERS)} runs it all the same"
            left_out = {solver.name: reason for solver in solvers if solver.referee}
        stopwatch.stage = "solve/lp"
        stopwatch.progress.begin(settings.parameters.root)
        found = compare_solvers(prepared, chosen, progress=stopwatch.progress)
        for solver in chosen[len(found.runs) :]:
            left_out[name_of(solver)] = "interrupted before its turn"
        once = {name: stopwatch.spans.get(span, 0.0) for name, span in ONCE.items()}
        return solvers_document(found, prepared, left_out, once, pairs.warnings)

    answer = run(work, stopwatch, show=not quiet)
    show(answer, options.output, {}, lambda: solver_pictures(answer))
    if not answer["agree"]:
        print_notice(
            "brackets do not overlap: " + "; ".join(map(" and ".join, answer["contradictions"]))
        )
    unfinished = [made for made in answer["runs"] if not made["finished"]]
    for made in unfinished:
        missed = "" if made["total"] is None else "accuracy not reached: "
        print_notice(f"{missed}{made['name']}: {made['status']}")
    return answer["agree"] and not unfinished
