"""``tgospa-eval associate A B``: association of the states of two sensors."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import click

from tgospa_eval._version import __version__
from tgospa_eval.api.options import NAMES, OPTION_SPECS, Request
from tgospa_eval.cli.shared import click_builder
from tgospa_eval.cli.shared.command import PATH, SOURCE, Option, Verb
from tgospa_eval.errors import InputError

if TYPE_CHECKING:
    from tgospa_eval.api.resolve import ResolvedRequest
    from tgospa_eval.api.sensors import Association
    from tgospa_eval.distances import Resources
    from tgospa_eval.formats import Reading
    from tgospa_eval.results.records import Json

T = TypeVar("T")

SENSOR_OPTIONS = [
    key
    for key, name in NAMES.items()
    if OPTION_SPECS[name].sensors and not key.startswith(("truth-", "estimate-", "cutoff"))
]
"""Options that this verb shares with ``evaluate``, by their names in a settings file."""

_output = partial(Option, section="Output")


@click.command(
    "associate",
    cls=Verb,
    params=[
        Option(
            "-c, --cutoff C",
            "Cutoff c > 0: states farther apart are not associated, and each costs c/2.",
            section="Metric",
            type=float,
            required=True,
        ),
        *click_builder.chosen_options(
            SENSOR_OPTIONS,
            *(
                click_builder.side_option(f"{role}_{what}", side)
                for what in ("format", "columns", "where")
                for role, side in (("truth", "a"), ("estimate", "b"))
            ),
            click_builder.format_option("table", "json", "csv"),
            _output(
                "--cost-matrix FILE",
                "Write the distances of all pairs of each step to a CSV file.",
                type=PATH,
            ),
            _output(
                "--cross-cov FILE",
                "Write the cross-covariances of associated clouds to a CSV file.",
                type=PATH,
            ),
            _output(
                "-o, --output DIR",
                "Write report.html, associate.json, associations.csv and a picture of the plane to "
                "this folder.",
                type=PATH,
            ),
            *(item for item in click_builder.PICTURE_OPTIONS if item.key != "components"),
            _output("--force", "Write over files that exist."),
        ),
    ],
)
@click.argument("a", type=SOURCE)
@click.argument("b", type=SOURCE)
def command(
    a: str, b: str, *, cost_matrix: str | None, cross_cov: str | None, force: bool, **options: Any
) -> None:
    """Associate the states of two sensors, A and B, at every step.

    The association with the least sum of distances is printed. A state without a
    partner costs c/2. The files are read as evaluate reads them.

    \b
    Examples:
      tgospa-eval associate radar.csv lidar.csv -c 10
      tgospa-eval associate radar.csv lidar.csv -c 3 --distance mahalanobis

    Exit status: 0 done, 2 wrong option, 3 bad input file.
    """
    from tgospa_eval.api.resolve import resolve_request
    from tgospa_eval.api.sensors import associate_sides, of_pairs
    from tgospa_eval.cli.shared.streams import emit
    from tgospa_eval.cli.shared.writing import probed, write_output
    from tgospa_eval.common.config import settings_field
    from tgospa_eval.common.writing import write_file
    from tgospa_eval.results.records import json_text
    from tgospa_eval.show.files import ASSOCIATION, association_files, check_file
    from tgospa_eval.show.result_text import association_text
    from tgospa_eval.show.table_text import csv_text

    options |= {"force": force}
    request = Request.of(of_pairs(options))
    output, taken = click_builder.OutputOptions.of(options), [a, b]
    requested = {"--cost-matrix": cost_matrix, "--cross-cov": cross_cov}
    files = {name: path for name, path in requested.items() if path}
    for name, path in files.items():
        check_file(path, name, force=force, inputs=taken)
        taken.append(path)
    wanted = probed(output, ASSOCIATION, "associate")
    resolved = resolve_request(request)

    def work(resources: "Resources") -> "tuple[Association, dict[str, str]]":
        sides = read_states((a, b), resolved, ("--a-format", "--b-format"), quiet=output.quiet)
        every = "--cost-matrix" in files
        association = associate_sides(resolved, sides, (a, b), resources, all_pairs=every)
        make = {
            "--cost-matrix": association.costs_table,
            "--cross-cov": association.cross_covariances_table,
        }
        return association, {name: csv_text(make[name]()) for name in files}

    association, texts = run_with_resources(work, request.jobs, quiet=output.quiet)
    for name, path in files.items():
        write_file(path, texts[name], name)
    used = settings_field(output.config)
    shown = {
        "table": lambda: association_text(association),
        "json": lambda: json_text(_document(association, resolved) | used),
        "csv": lambda: csv_text(association.associations_table()),
    }
    write_output(
        output,
        ASSOCIATION,
        lambda _: {
            "associate.json": shown["json"](),
            **association_files(association, (a, b), wanted),
        },
    )
    emit(shown[output.format_](), output.format_)


def _document(association: "Association", resolved: "ResolvedRequest") -> "Json":
    """Return the JSON document of ``associate``."""
    from tgospa_eval.results.records import records

    columns = association.first.columns
    return {
        "schema": "tgospa-eval/associate/1",
        "version": __version__,
        "parameters": {
            "cutoff": association.cutoff,
            "distance": association.distance.name,
            **association.distance.settings(columns),
            "columns": list(columns),
            **resolved.evaluation.time_matching.recorded,
            **resolved.recorded,
        },
        "counts": {
            "steps": len(association.first.times),
            "associated": int(association.chosen.sum()),
            "alone_a": association.unassigned[0],
            "alone_b": association.unassigned[1],
        },
        "total": association.total,
        "associations": records(association.associations_table()),
    }


def read_states(
    paths: tuple[str, ...], resolved: "ResolvedRequest", formats: tuple[str, ...], *, quiet: bool
) -> "tuple[Reading, ...]":
    """Read the states of sensors, and print notices about the files.

    Files in the format of a benchmark are read like results of trackers, not like a truth. Messages
    name the options in `formats`, such as ``--a-format``, instead of those of truth and estimate.
    """
    from tgospa_eval.api.notices import about
    from tgospa_eval.api.reading import read_pair
    from tgospa_eval.cli.shared.streams import notifier

    try:
        sides = read_pair(resolved, *paths, roles=("estimate",) * len(paths))
    except InputError as error:
        generic = "(--truth-format, --estimate-format)"
        way = f"({', '.join(formats)})"
        raise InputError(*(line.replace(generic, way) for line in error.args)) from None
    notify = notifier(quiet=quiet)
    for path, side, name in zip(paths, sides, formats, strict=True):
        for notice in about(path, side):
            notify(replace(notice, text=notice.text.replace("--estimate-format", name)))
    return sides


def run_with_resources(work: "Callable[[Resources], T]", jobs: int | None, *, quiet: bool) -> T:
    """Call `work` with resources for `jobs` threads, and show its progress."""
    from tgospa_eval.cli.shared.progress import new_stopwatch, run
    from tgospa_eval.distances import Resources

    stopwatch = new_stopwatch(quiet=quiet)
    resources = Resources(jobs=jobs, stopwatch=stopwatch)
    return run(lambda: work(resources), stopwatch, show=not quiet)
