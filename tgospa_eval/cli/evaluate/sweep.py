"""``evaluate --sweep``: parses the values of a parameter, evaluates them, prints and writes."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tgospa_eval.api.compare import sweep_sides, swept_parameters
from tgospa_eval.api.options import Request
from tgospa_eval.api.report import Sweep
from tgospa_eval.cli.shared.click_builder import OutputOptions
from tgospa_eval.cli.shared.progress import new_stopwatch, run
from tgospa_eval.cli.shared.streams import emit, notifier, print_notice
from tgospa_eval.cli.shared.writing import can_draw, probed, write_output
from tgospa_eval.common.words import parsed, parsed_whole
from tgospa_eval.errors import ConfigError
from tgospa_eval.quoting import quoted
from tgospa_eval.show.chart_list import pictures
from tgospa_eval.show.comparison import sweep_document
from tgospa_eval.show.files import SWEEP, Files
from tgospa_eval.show.html import document_page
from tgospa_eval.show.table_text import csv_text

if TYPE_CHECKING:
    from tgospa_eval.show.chart_list import Pictures

SWEPT = {
    "c": "cutoff",
    "cutoff": "cutoff",
    "p": "order",
    "order": "order",
    "g": "switch_penalty",
    "gamma": "switch_penalty",
    "switch-penalty": "switch_penalty",
    "rho": "rho",
}
MAX_VALUES = 1000
"""Largest number of values of a sweep."""

FORM = "NAME=FROM:TO:COUNT, NAME=FROM:TO:COUNT:log or NAME=VALUE,VALUE,..."


def sweep_files(
    paths: tuple[str, str],
    texts: tuple[str, ...],
    options: Request,
    output: OutputOptions,
    typed: set[str],
) -> bool:
    """Evaluate two files for several values of a parameter, print and write.

    Return whether all evaluations reached the requested accuracy.

    Parameters
    ----------
    paths : pair of str
        Truth and estimate.
    texts : tuple of str
        Texts of ``--sweep``, such as ``"gamma=1,2,5"``; only one is allowed.
    options : Request
        What to evaluate, and how.
    output : OutputOptions
        What to print, and where to write.
    typed : set of str
        Names of the parameters that were typed on the command line.

    Raises
    ------
    TgospaError
        An option or a file is wrong.
    """
    name, values = parse_sweep(texts)
    _check(name, options, output, typed)
    settings, parameters = swept_parameters(options, name, values)
    wanted = probed(output, SWEEP, "sweep")
    stopwatch = new_stopwatch(quiet=output.quiet)

    def work() -> Sweep:
        notify = notifier(quiet=output.quiet)
        swept = sweep_sides(settings, name, parameters, paths, stopwatch, notify)
        return replace(swept, settings_file=output.config)

    swept = run(work, stopwatch, show=not output.quiet)
    if len(swept.points) < len(parameters):
        print_notice(f"interrupted: {len(swept.points)} of {len(parameters)} points are finished")
    _show(swept, output, wanted)
    missed = [point for point in swept.points if not point.finished]
    for point in missed:
        print_notice(
            f"accuracy not reached at {_key(name)} {point.value:g}: solver {point.status}, the "
            f"relative gap is {point.relative_gap:.2g}"
        )
    return not missed


def parse_sweep(texts: tuple[str, ...]) -> tuple[str, list[float]]:
    """Return the parameter that ``--sweep`` names, as a field of `Parameters`, and its values.

    Raises
    ------
    ConfigError
        The text is not ``NAME=VALUES``, or there are several texts.
    """
    if len(texts) > 1:
        raise ConfigError("--sweep is given twice: only one parameter can be swept")
    text = texts[0]
    name, equals, values = (part.strip() for part in text.partition("="))
    if not equals or name not in SWEPT:
        raise ConfigError(f"--sweep {quoted(text)}: must be {FORM}; NAME is c, p, gamma or rho")
    if ":" in values:
        return SWEPT[name], _range(text, values.split(":"))
    return SWEPT[name], [_number(text, part) for part in values.split(",")]


def _range(text: str, parts: list[str]) -> list[float]:
    logarithmic = len(parts) == 4 and parts[3].strip() == "log"
    if len(parts) != 3 and not logarithmic:
        raise ConfigError(f"--sweep {quoted(text)}: must be {FORM}")
    low, high = (_number(text, part) for part in parts[:2])
    count = parsed_whole(parts[2]) or 0
    if not 2 <= count <= MAX_VALUES:
        raise ConfigError(
            f"--sweep {quoted(text)}: COUNT must be a whole number from 2 to {MAX_VALUES}"
        )
    if not low < high:
        raise ConfigError(f"--sweep {quoted(text)}: FROM must be less than TO")
    if logarithmic and low <= 0:
        raise ConfigError(f"--sweep {quoted(text)}: with :log FROM must be more than 0")
    made = (np.geomspace if logarithmic else np.linspace)(low, high, count)
    # Values are rounded to 12 digits, so that they are 0.3 and not 0.30000000000000004.
    return [low, *(float(f"{value:.12g}") for value in made[1:-1]), high]


def _number(text: str, part: str) -> float:
    value = parsed(part)
    if value is None:
        raise ConfigError(
            f"--sweep {quoted(text)}: {quoted(part.strip())} is not a number; must be {FORM}"
        )
    return value


def _check(name: str, options: Request, output: OutputOptions, typed: set[str]) -> None:
    """Check that other options do not contradict the sweep of the parameter `name`.

    Raises
    ------
    ConfigError
        Another option contradicts the sweep.
    """
    if name in typed and not output.quiet:
        print_notice(
            f"--{_key(name)} {getattr(options, name):g} is ignored: --sweep gives its values"
        )
    for odd in ("components", "plane"):
        if odd in typed:
            raise ConfigError(f"--{odd} is not for the picture of --sweep: leave one of them out")
    for given, name in ((options.curve, "curve"), (options.window, "window")):
        if given:
            raise ConfigError(f"--sweep and --{name}: leave one of them out")
    if options.by:
        if "by" in typed:
            raise ConfigError(
                "--by class: --sweep evaluates all classes together; choose one class by --class "
                "NAME"
            )
        if not output.quiet:
            print_notice(
                "by = class in the settings is ignored: --sweep evaluates all classes together"
            )


def _key(name: str) -> str:
    return name.replace("_", "-")


def _show(swept: Sweep, output: OutputOptions, wanted: "Pictures | None") -> None:
    """Print the points, and write the folder of ``-o`` if requested."""

    def make(notify: Callable[[str, float], None]) -> Files:
        notify("the sweep", 0.0)
        draws = wanted is not None and can_draw(quiet=output.quiet)
        files: dict[str, str | bytes] = {
            "sweep.json": swept.to_json(),
            "sweep.csv": csv_text(swept.columns()),
            "report.html": document_page(sweep_document(swept), "sweep", swept, draws=draws),
        }
        return files | (pictures("sweep", swept, wanted) if draws else {})

    write_output(output, SWEEP, make)
    emit(swept.rendered(output.format_), output.format_)
