"""From the options of associate and reduce to files and stdout."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from tgospa_eval._version import __version__
from tgospa_eval.cli.shared.notices import about, notifier
from tgospa_eval.cli.shared.particles import reduction
from tgospa_eval.cli.shared.progress import run
from tgospa_eval.cli.shared.settings import Settings, make_settings
from tgospa_eval.cli.shared.streams import emit, print_notice
from tgospa_eval.cli.shared.values import EvaluationOptions, OutputOptions
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.distances import Effort, Reduction
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.formats import Reading
from tgospa_eval.formats.write import TABLES
from tgospa_eval.inspection import spread
from tgospa_eval.reports.clouds import (
    association_text,
    reduction_text,
)
from tgospa_eval.reports.files import check_file, csv_text, write_file
from tgospa_eval.results.records import json_text, records
from tgospa_eval.sensors.association import associate
from tgospa_eval.sensors.reduction import reduce_trajectories

T = TypeVar("T")


def associate_files(paths: tuple[str, str], options: dict[str, Any]) -> None:
    """Read, associate, print and write.

    Raises
    ------
    TgospaError
        Something is wrong with options or files.
    """
    files = {name: options[name] for name in ("cost_matrix", "cross_cov") if options[name]}
    taken = list(paths)
    for name, path in files.items():
        check_file(path, force=options["force"], option=_spelt(name))
        _check_apart(path, taken, _spelt(name))
        taken.append(path)
    chosen = {"pairwise": True, "sides": ("a", "b"), "switch_penalty": 0.0} | options
    settings = make_settings(EvaluationOptions.of(chosen), OutputOptions.of(options))
    cutoff = settings.parameters.cutoff

    def work(effort: Effort) -> tuple[dict[str, Any], dict[str, Any]]:
        sides = _read(paths, settings, options, ("--a-format", "--b-format"))
        fitted, _ = settings.fit(sides, paths)
        distance, aligned = fitted.distance, fitted.alignment
        found = associate(
            aligned.truth,
            aligned.estimate,
            cutoff=cutoff,
            distance=distance,
            all_pairs="cost_matrix" in files,
            effort=effort,
        )
        count = int(found.chosen.sum())
        document = {
            "schema": "tgospa-eval/associate/1",
            "version": __version__,
            "parameters": {
                "cutoff": cutoff,
                "distance": distance.name,
                **distance.settings(aligned.truth.columns),
                "columns": list(aligned.truth.columns),
                "grid": settings.time_matching.grid,
                "time_tolerance": settings.time_matching.tolerance,
                **settings.recorded,
            },
            "counts": {
                "steps": len(aligned.truth.times),
                "associated": count,
                "alone_a": len(aligned.truth.step) - count,
                "alone_b": len(aligned.estimate.step) - count,
            },
            "total": found.total,
            "associations": records(found.associations_table()),
        }
        tables = {"associations": found.associations_table()}
        if "cost_matrix" in files:
            tables["cost_matrix"] = found.costs_table()
        if "cross_cov" in files:
            tables["cross_cov"] = found.cross_covariances_table()
        return document, tables

    document, tables = _run(work, options)
    for name, path in files.items():
        write_file(path, csv_text(tables[name]), _spelt(name))
    texts = {
        "table": lambda: association_text(document),
        "json": lambda: json_text(document),
        "csv": lambda: csv_text(tables["associations"]),
    }
    emit(texts[options["format_"]](), options["format_"])


def reduce_file(source: str, target: str, options: dict[str, Any]) -> None:
    """Read, reduce, write and print what changed.

    Raises
    ------
    TgospaError
        Something is wrong with options or files.
    """
    check_file(target, force=options["force"], option="OUT")
    _check_apart(target, [source], "OUT")
    suffix = Path(target).suffix.casefold()
    if suffix not in TABLES:
        raise ConfigError(f"OUT {target}: must end in {', '.join(TABLES)}")
    size = options["size"]
    how = reduction(EvaluationOptions.of(options), size) or Reduction(size=size)
    fixed = {"distance": "cloud-wasserstein", "reduce": size, "cutoff": 1.0, "switch_penalty": 0.0}
    chosen = EvaluationOptions.of(fixed | options)
    settings = make_settings(chosen, OutputOptions.of(options))

    def work(effort: Effort) -> tuple[Reading, bytes, dict[str, list[Any]]]:
        (side,) = _read((source,), settings, options, ("--in-format",))
        if side.trajectories.clouds is None:
            raise InputError(
                f"{source}: no particles; a column weight makes the rows of an (id, t) a cloud"
            )
        after, table = reduce_trajectories(side.trajectories, how, effort)
        return side, TABLES[suffix](after), table

    side, data, table = _run(work, options)
    write_file(target, data, "OUT")
    document = {
        "schema": "tgospa-eval/reduce/1",
        "version": __version__,
        "parameters": {
            **how.settings(),
            "columns": list(side.trajectories.columns),
            **settings.recorded,
        },
        "counts": {
            "clouds": len(table["id"]),
            "particles": sum(table["particles"]),
            "kept": sum(table["kept"]),
        },
        "change": {name: _spread(name, table[name]) for name in list(table)[4:]},
        "clouds": records(table),
    }
    texts = {
        "table": lambda: reduction_text(document),
        "json": lambda: json_text(document),
        "csv": lambda: csv_text(table),
    }
    emit(texts[options["format_"]](), options["format_"])


def _check_apart(path: str, others: list[str], option: str) -> None:
    """Whether what is written would replace what is read, or is written as well.

    Raises
    ------
    ConfigError
        It would.
    """
    for other in others:
        if os.path.realpath(path) == os.path.realpath(other):
            raise ConfigError(f"{option} {path}: is read or written otherwise; name another file")


def _read(
    paths: tuple[str, ...], settings: Settings, options: dict[str, Any], formats: tuple[str, ...]
) -> tuple[Reading, ...]:
    """The states of sensors: the role of challenge formats is that of results.

    `formats` are the options that name the formats; messages know those of truth and estimate.
    """
    try:
        sides = settings.read(*paths, roles=("estimate",) * len(paths))
    except InputError as error:
        usual = "(--truth-format, --estimate-format)"
        raise InputError(str(error).replace(usual, f"({', '.join(formats)})")) from None
    tell = notifier(quiet=options["quiet"])
    for path, side, option in zip(paths, sides, formats, strict=True):
        for notice in about(path, side):
            tell(replace(notice, text=notice.text.replace("--estimate-format", option)))
    return sides


def _run(work: Callable[[Effort], T], options: dict[str, Any]) -> T:
    stopwatch = Stopwatch()
    if not options["quiet"]:
        stopwatch.notify = print_notice
    effort = Effort(jobs=options["jobs"], stopwatch=stopwatch)
    return run(lambda: work(effort), stopwatch, show=not options["quiet"])


def _spread(name: str, values: list[float | None]) -> dict[str, float] | None:
    """Of what is known; nothing of distances of which some are not, those of large changes."""
    import numpy as np

    known = [value for value in values if value is not None]
    if name == "wasserstein" and len(known) < len(values):
        return None
    return spread(np.array(known))


def _spelt(name: str) -> str:
    return "--" + name.replace("_", "-")
