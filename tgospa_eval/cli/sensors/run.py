"""From the options of associate and reduce to files and stdout."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from tgospa_eval._version import __version__
from tgospa_eval.api.distance import reduction
from tgospa_eval.api.notices import about
from tgospa_eval.api.request import Request
from tgospa_eval.api.settings import Settings, make_settings
from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.streams import emit, notifier, print_notice
from tgospa_eval.cli.shared.values import OutputOptions
from tgospa_eval.cli.shared.writing import check_apart
from tgospa_eval.common.config import settings_field
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.distances import Distance, Effort, Reduction
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats import Reading
from tgospa_eval.formats.write import TABLES
from tgospa_eval.inspection import spread
from tgospa_eval.reports.clouds import association_text, reduction_text
from tgospa_eval.reports.files import check_file, csv_text, write_file
from tgospa_eval.results.records import Columns, Json, json_text, records
from tgospa_eval.sensors.association import Association, associate
from tgospa_eval.sensors.reduction import CloudChange, reduce_trajectories

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class SensorOptions(OutputOptions):
    """Options that only these verbs have, beside those of what is printed and written."""

    cost_matrix: str | None = None
    cross_cov: str | None = None
    size: int = 1


def associate_files(paths: tuple[str, str], options: Request, output: SensorOptions) -> None:
    """Read, associate, print and write.

    Raises
    ------
    TgospaError
        An option or a file is wrong, or an output exists, without ``--force``.
    """
    asked = {"--cost-matrix": output.cost_matrix, "--cross-cov": output.cross_cov}
    files = {option: path for option, path in asked.items() if path}
    taken = list(paths)
    for option, path in files.items():
        check_file(path, force=output.force, option=option)
        check_apart(path, taken, option)
        taken.append(path)
    settings = make_settings(options)

    def work(effort: Effort) -> tuple[Association, Distance, dict[str, str]]:
        sides = _read(paths, settings, ("--a-format", "--b-format"), quiet=output.quiet)
        fitted, _ = settings.fit(sides, paths)
        found = associate(
            fitted.alignment.truth,
            fitted.alignment.estimate,
            cutoff=settings.evaluation.parameters.cutoff,
            distance=fitted.distance,
            all_pairs="--cost-matrix" in files,
            effort=effort,
        )
        make = {"--cost-matrix": found.costs_table, "--cross-cov": found.cross_covariances_table}
        return found, fitted.distance, {option: csv_text(make[option]()) for option in files}

    found, distance, texts = _run(work, options.jobs, quiet=output.quiet)
    for option, path in files.items():
        write_file(path, texts[option], option)
    used = settings_field(output.config)
    shown = {
        "table": lambda: association_text(found),
        "json": lambda: json_text(_association(found, distance, settings) | used),
        "csv": lambda: csv_text(found.associations_table()),
    }
    emit(shown[output.format_](), output.format_)


def _association(found: Association, distance: Distance, settings: Settings) -> Json:
    """The document of ``associate``."""
    columns = found.first.columns
    return {
        "schema": "tgospa-eval/associate/1",
        "version": __version__,
        "parameters": {
            "cutoff": found.cutoff,
            "distance": distance.name,
            **distance.settings(columns),
            "columns": list(columns),
            **settings.evaluation.time_matching.recorded,
            **settings.recorded,
        },
        "counts": {
            "steps": len(found.first.times),
            "associated": int(found.chosen.sum()),
            "alone_a": found.unassigned[0],
            "alone_b": found.unassigned[1],
        },
        "total": found.total,
        "associations": records(found.associations_table()),
    }


def reduce_file(source: str, target: str, options: Request, output: SensorOptions) -> None:
    """Read, reduce, write and print what changed.

    Raises
    ------
    TgospaError
        An option or the file is wrong, it has no clouds, or the output exists, without ``--force``.
    """
    check_file(target, force=output.force, option="OUT")
    check_apart(target, [source], "OUT")
    suffix = Path(target).suffix.casefold()
    if suffix not in TABLES:
        raise ConfigError(f"OUT {target}: must end in {', '.join(TABLES)}")
    how = reduction(options, output.size) or Reduction(size=output.size)
    clouds = replace(options, distance="cloud-wasserstein", reduce=output.size)
    settings = make_settings(replace(clouds, cutoff=1.0, switch_penalty=0.0))

    def work(effort: Effort) -> tuple[Reading, bytes, Columns]:
        (side,) = _read((source,), settings, ("--in-format",), quiet=output.quiet)
        if side.trajectories.clouds is None:
            raise InputError(
                f"{source}: no particles; a column weight makes the rows of an (id, t) a cloud"
            )
        after, table = reduce_trajectories(side.trajectories, how, effort)
        return side, TABLES[suffix](after), table

    side, data, table = _run(work, options.jobs, quiet=output.quiet)
    write_file(target, data, "OUT")
    counts = {
        "clouds": len(table["id"]),
        "particles": sum(table["particles"]),
        "kept": sum(table["kept"]),
    }
    change = {name: _spread(name, table[name]) for name in CloudChange._fields[2:]}
    document = {
        "schema": "tgospa-eval/reduce/1",
        "version": __version__,
        "parameters": {
            **how.settings(),
            "columns": list(side.trajectories.columns),
            **settings.recorded,
        },
        "counts": counts,
        "change": change,
        "clouds": records(table),
        **settings_field(output.config),
    }
    texts = {
        "table": lambda: reduction_text(counts, change),
        "json": lambda: json_text(document),
        "csv": lambda: csv_text(table),
    }
    emit(texts[output.format_](), output.format_)


def _read(
    paths: tuple[str, ...], settings: Settings, formats: tuple[str, ...], *, quiet: bool
) -> tuple[Reading, ...]:
    """The states of sensors: the role of challenge formats is that of results.

    `formats` are the options that name the formats; messages know those of truth and estimate.
    """
    try:
        sides = settings.read(*paths, roles=("estimate",) * len(paths))
    except InputError as error:
        usual = "(--truth-format, --estimate-format)"
        raise InputError(str(error).replace(usual, f"({', '.join(formats)})")) from None
    notify = notifier(quiet=quiet)
    for path, side, option in zip(paths, sides, formats, strict=True):
        for notice in about(path, side):
            notify(replace(notice, text=notice.text.replace("--estimate-format", option)))
    return sides


def _run(work: Callable[[Effort], T], jobs: int | None, *, quiet: bool) -> T:
    stopwatch = Stopwatch()
    if not quiet:
        stopwatch.notify = print_notice
    effort = Effort(jobs=jobs, stopwatch=stopwatch)
    return run(lambda: work(effort), stopwatch, show=not quiet)


def _spread(name: str, values: list[float | None]) -> dict[str, float] | None:
    """Of what is known; nothing of distances of which some are not, those of large changes."""
    import numpy as np

    known = [value for value in values if value is not None]
    if name == "wasserstein" and len(known) < len(values):
        return None
    return spread(np.array(known))
