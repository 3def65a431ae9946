"""From the options of ``compare`` to a document, and the document to stdout and files."""

from collections.abc import Callable
from typing import Any

from tgospa_eval import plots
from tgospa_eval.cli.progress import run
from tgospa_eval.cli.settings import Settings, make_settings
from tgospa_eval.cli.work import default_notice, emit, pair_remarks, say, say_if_slow, told
from tgospa_eval.comparison.runs import check_solvers, takes_long
from tgospa_eval.comparison.solvers import compare_solvers, document
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats import ROLES, Reading, read
from tgospa_eval.pipeline import Prepared, prepare
from tgospa_eval.plots.comparison import solver_pictures
from tgospa_eval.reports.comparison import Document, json_text, render
from tgospa_eval.reports.files import check_folder, write_texts
from tgospa_eval.solvers import SOLVERS, Solver, solver_class
from tgospa_eval.timing import Stopwatch

GIVEN = ("cutoff", "switch_penalty")


def compare_files(truth: str, estimate: str, options: dict[str, Any], given: set[str]) -> bool:
    """One pair through several solvers; whether all did what was asked, and agree.

    Raises
    ------
    TgospaError
        Something is wrong with options or files.
    """
    solvers = make_solvers(options, options["solvers"] or ",".join(SOLVERS))
    settings = _settings(options, given)
    stopwatch = Stopwatch()

    def work() -> Document:
        prepared = Pairs(settings, options, given, stopwatch).prepared(truth, estimate)
        chosen, left_out = list(solvers), {}
        states = takes_long(prepared)
        if "solvers" not in given and states is not None:
            chosen = [solver for solver in solvers if solver.name != "exact"]
            left_out["exact"] = (
                f"{states:,} reduced states, it would take minutes; --solvers "
                f"{','.join(SOLVERS)} runs it all the same"
            )

        def tell(name: str) -> None:
            stopwatch.stage = f"running {name}"

        found = compare_solvers(prepared, chosen, say=tell)
        once = {
            name: stopwatch.spans.get(span, 0.0)
            for name, span in (
                ("read", "read"),
                ("distances", "distances"),
                ("preparation", "solve/preparation"),
            )
        }
        return document(found, prepared, left_out, once)

    answer = run(work, stopwatch, show=not options["quiet"])
    show(answer, options, {}, solver_pictures)
    return bool(answer["agree"]) and all(item["finished"] for item in answer["runs"])


def _settings(options: dict[str, Any], given: set[str]) -> Settings:
    """The records that the options ask for; the folder is looked at before any work is done."""
    if options["output"] is not None:
        check_folder(options["output"], force=options["force"])
    return make_settings(options | {"by": None}, {name: name in given for name in GIVEN})


class Pairs:
    """Pairs of files, read and made problems of; a truth is read once.

    Parameters
    ----------
    settings : Settings
        How to read, and the metric.
    options, given
        Values of the options, and the names of those that are no defaults.
    stopwatch : Stopwatch
        Gets the time by stage.
    """

    def __init__(
        self, settings: Settings, options: dict[str, Any], given: set[str], stopwatch: Stopwatch
    ) -> None:
        self.settings, self.stopwatch = settings, stopwatch
        self.quiet = options["quiet"]
        self.given = {name: name in given for name in GIVEN}
        self.told: set[str] = set()
        self.last: tuple[str, Reading] | None = None
        if not self.quiet:
            say_if_slow()

    def prepared(self, truth: str, estimate: str) -> Prepared:
        """The problem of two files."""
        with self.stopwatch.span("read"):
            if self.last is None or self.last[0] != truth:
                self.last = truth, self._read(truth, 0)
            sides = self.last[1], self._read(estimate, 1)
        settings, paths = self.settings, (truth, estimate)
        distance, aligned = settings.fit(sides, paths)
        if not self.quiet:
            for text in pair_remarks(sides, aligned, distance, settings):
                self._say_once(text)
            if not all(self.given.values()):
                self._say_once(default_notice(aligned, distance, settings, self.given), "default")
        del aligned
        return prepare(
            sides[0].trajectories,
            sides[1].trajectories,
            parameters=settings.parameters,
            distance=distance,
            stamps=settings.stamps,
            unit=settings.unit,
            settings=settings.recorded,
            inputs=(told(sides[0]), told(sides[1])),
            stopwatch=self.stopwatch,
        )

    def _read(self, path: str, side: int) -> Reading:
        found = read(path, self.settings.reading, ROLES[side], self.settings.formats[side])
        for notice in () if self.quiet else found.notices:
            self._say_once(f"{path}: {notice}")
        return found

    def _say_once(self, text: str, key: str | None = None) -> None:
        key = key or text
        if key not in self.told:
            self.told.add(key)
            say(text)


def make_solvers(options: dict[str, Any], names: str) -> list[Solver]:
    """The solvers of a list of names, `sinkhorn` once for each temperature.

    Raises
    ------
    ConfigError
        A name or a number is not known, or one is there twice.
    """
    limits = {"time_limit": options["time_limit"]}
    sweeping = {"gap": options["gap"], "jobs": options["jobs"], **limits}
    solvers: list[Solver] = []
    for name in (part.strip() for part in names.split(",")):
        if name not in SOLVERS:
            raise ConfigError(f'--solvers "{name}": must be of {", ".join(SOLVERS)}')
        make: Any = solver_class(name)
        if name == "sinkhorn":
            temperatures = numbers("epsilon", str(options["epsilon"]), float)
            solvers += [make(epsilon=epsilon, **sweeping) for epsilon in temperatures]
        else:
            solvers.append(make(**(limits if name == "exact" else sweeping)))
    check_solvers(solvers)
    return solvers


def numbers(option: str, text: str, kind: Any) -> list[Any]:
    """The numbers of a list with commas.

    Raises
    ------
    ConfigError
        One is none.
    """
    found = []
    for part in map(str.strip, text.split(",")):
        try:
            found.append(kind(part))
        except ValueError:
            what = "whole numbers" if kind is int else "numbers"
            raise ConfigError(f'--{option} "{part}": must be {what} with commas') from None
    return found


def show(
    answer: Document,
    options: dict[str, Any],
    tables: dict[str, str],
    draw: Callable[[Document], dict[str, Any]],
) -> None:
    """Print the document, and write the folder if one was asked for.

    Parameters
    ----------
    answer : dict
        The document.
    options : dict
        Values of the options.
    tables : dict
        Further files by name.
    draw : callable
        Makes figures by name of the document; it is called where matplotlib is there.
    """
    if options["output"] is not None:
        files: dict[str, str | bytes] = {
            "compare.json": json_text(answer),
            "compare.csv": render(answer, "csv"),
            **tables,
        }
        if plots.available():
            files |= {f"{name}.png": plots.png(made) for name, made in draw(answer).items()}
        elif not options["quiet"]:
            say(plots.MISSING)
        write_texts(files, options["output"], force=options["force"])
    emit(render(answer, options["format_"]))
