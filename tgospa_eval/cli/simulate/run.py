"""From the options of ``simulate`` to files."""

import shlex
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from tgospa_eval.cli.shared.streams import emit
from tgospa_eval.cli.simulate.values import SceneOptions
from tgospa_eval.common.words import counted
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats.write import WRITERS
from tgospa_eval.reports.folders import Kind, probe_folder, write_texts
from tgospa_eval.simulation import Scene, Tracker, simulate
from tgospa_eval.text import visible
from tgospa_eval.tracks.trajectories import Trajectories

DISTANCE_OF_STATE = {"gaussian": "gaussian-wasserstein", "cloud": "cloud-wasserstein"}
"""Distances of states that are more than points."""

OPTION = "DIR"
"""What messages about the folder begin with."""


def make_scene(folder: str, options: SceneOptions) -> None:
    """Make a scene, write it, print what was made.

    Raises
    ------
    ConfigError
        An option has no meaning, or the folder cannot be written.
    """
    names = ("truth.csv", "estimate.csv") if options.format_ == "csv" else ("gt.txt", "res.txt")
    kind = Kind(name="simulate", document=names[0], names=names)
    probe_folder(folder, kind, force=options.force, option=OPTION)
    scene, tracker = settings(options)
    truth, estimate = simulate(scene, tracker, np.random.default_rng(options.seed))
    if options.format_ == "kitti":  # whose frames count from 0
        truth, estimate = (replace(side, times=side.times - 1) for side in (truth, estimate))
    write = WRITERS[options.format_]
    texts = {
        name: write(side, role)
        for name, side, role in zip(names, (truth, estimate), ("truth", "estimate"), strict=True)
    }
    write_texts(texts, folder, kind, force=options.force, option=OPTION)
    if options.quiet:
        return
    lines = (
        f"{folder}: {scene.scenario}, {counted(scene.steps, 'step')}; "
        f"{size_of(truth, 'truth')} in {names[0]}, "
        f"{size_of(estimate, 'estimate')} in {names[1]}",
        _command(folder, names, options, tracker),
    )
    emit("".join(f"{visible(line)}\n" for line in lines))


def settings(options: SceneOptions) -> tuple[Scene, Tracker]:
    """The scene and the tracker that the options of `simulate` ask for."""
    boxes = options.format_ != "csv"
    if boxes and options.state not in (None, "box"):
        raise ConfigError(
            f"--state {options.state}: {options.format_} files hold boxes; leave it out"
        )
    if options.particles is not None and options.state != "cloud":
        raise ConfigError("--particles is for --state cloud")
    scene = Scene(
        state=options.state or ("box" if boxes else "point"),
        particles=options.particles or 100,
        scenario=options.scenario,
        targets=options.targets,
        steps=options.steps,
        area=options.area,
    )
    scaled = {"noise": scene.area / 200, "near": scene.area / 20}
    given: dict[str, Any] = {field.name: getattr(options, field.name) for field in fields(Tracker)}
    given |= {name: value for name, value in scaled.items() if given[name] is None}
    return scene, Tracker(**given)


def size_of(side: Trajectories, what: str) -> str:
    """How many tracks and rows, in words."""
    clouds = "" if side.clouds is None else f" of {counted(len(side.clouds.points), 'particle')}"
    return f"{counted(len(side.ids), what)} with {counted(len(side.step), 'row')}{clouds}"


def _command(folder: str, names: tuple[str, str], options: SceneOptions, tracker: Tracker) -> str:
    """With a cutoff well above the noise, and the price of a switch a quarter of it squared."""
    paths = " ".join(shlex.quote(str(Path(folder) / name)) for name in names)
    cutoff = max(options.area / 20, 5 * tracker.noise)
    format_ = options.format_
    formats = f" --truth-format {format_} --estimate-format {format_}" if format_ != "csv" else ""
    if options.state in DISTANCE_OF_STATE:
        formats += f" --distance {DISTANCE_OF_STATE[options.state]}"
    return f"tgospa-eval {paths}{formats} -c {cutoff:g} -g {cutoff / 2:g}"
