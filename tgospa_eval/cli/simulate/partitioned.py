"""From a kind of long recording to two folders of Parquet files, in memory of a stretch of it."""

import shlex
from collections.abc import Collection
from pathlib import Path

import numpy as np

from tgospa_eval.cli.shared.progress import Display
from tgospa_eval.cli.shared.streams import emit
from tgospa_eval.cli.simulate.run import OPTION
from tgospa_eval.cli.simulate.values import SceneOptions
from tgospa_eval.common.manifest import Entry, entry, read_manifest, unchanged
from tgospa_eval.common.progress import Progress
from tgospa_eval.common.timing import Stopwatch
from tgospa_eval.common.words import counted
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats.loading import check_parquet
from tgospa_eval.formats.write import PartWriter, part_name
from tgospa_eval.reports.folders import Kind, probe_folder, write_files
from tgospa_eval.simulation.kinds import RECORDINGS
from tgospa_eval.simulation.recordings import Layout, Rows
from tgospa_eval.simulation.streamed import simulate_recording
from tgospa_eval.text import visible

FOLDERS = ("truth", "estimate")


def make_partitioned(folder: str, options: SceneOptions) -> None:
    """Make a recording, write it, print what was made.

    Raises
    ------
    ConfigError
        The extra is missing, or the folder cannot be written.
    """
    check_parquet()
    recording = RECORDINGS[str(options.partitioned)]
    layout = Layout.of(recording, options.rows)
    names = [f"{side}/{part_name(k)}" for side in FOLDERS for k in range(layout.parts)]
    kind = Kind(name="simulate", document=names[0], names=names)
    probe_folder(folder, kind, force=options.force, option=OPTION)
    _check_strangers(folder, kind)
    counts = [_Count(), _Count()]
    stopwatch = Stopwatch()
    stopwatch.progress = Progress(watched=not options.quiet)

    def fill(fresh: Path) -> Collection[Entry]:
        counts[:] = _Count(), _Count()
        for side in FOLDERS:
            (fresh / side).mkdir()
        with PartWriter(fresh / FOLDERS[0]) as truth, PartWriter(fresh / FOLDERS[1]) as estimate:
            writers = truth, estimate
            stretches = simulate_recording(recording, layout, np.random.default_rng(options.seed))
            for number, sides in enumerate(stretches, start=1):
                for writer, count, rows in zip(writers, counts, sides, strict=True):
                    writer.add(vars(rows))
                    count.add(rows)
                    if number * layout.stretch % layout.part == 0:
                        writer.end_part()
                stopwatch.progress.done(min(number * layout.stretch / layout.steps, 1.0))
                if not options.quiet:
                    display.update()
        return [entry(fresh, name) for name in names]

    with Display(stopwatch) as display, stopwatch.span("simulating"):
        write_files(fill, folder, kind, force=options.force, option=OPTION)
    if options.quiet:
        return
    paths = " ".join(shlex.quote(str(Path(folder) / side)) for side in FOLDERS)
    lines = (
        f"{folder}: {options.partitioned}, {counted(layout.steps, 'step')}; "
        f"{counts[0].text('truth')} in truth/, {counts[1].text('estimate')} in estimate/, "
        f"{counted(layout.parts, 'file')} each",
        f"tgospa-eval evaluate {paths} -c {recording.cutoff:g} -g {recording.switch_penalty:g}",
    )
    emit("".join(f"{visible(line)}\n" for line in lines))


class _Count:
    """How many rows and tracks there are, in a byte for each track."""

    def __init__(self) -> None:
        self.rows = 0
        self.seen = np.zeros(0, bool)

    def add(self, rows: Rows) -> None:
        """Count some."""
        self.rows += len(rows.id)
        most = int(rows.id.max(initial=0)) + 1
        if most > len(self.seen):
            self.seen = np.append(self.seen, np.zeros(most, bool))
        self.seen[rows.id] = True

    def text(self, what: str) -> str:
        """In words."""
        return f"{counted(int(self.seen.sum()), what)} with {counted(self.rows, 'row')}"


def _check_strangers(folder: str, kind: Kind) -> None:
    """See that the folders of the sides hold nothing that would become part of the data.

    Raises
    ------
    ConfigError
        They do, and it is not of a run before.
    """
    path = Path(folder)
    own = {*kind.names, *unchanged(path, read_manifest(path, kind.name) or ())}
    for side in FOLDERS:
        if (path / side).is_file():
            raise ConfigError(f"{OPTION} {folder}: {side} in it is a file; name another folder")
        for item in sorted((path / side).glob("*")):
            if f"{side}/{item.name}" not in own:
                raise ConfigError(
                    f"{OPTION} {folder}: {side}/{item.name} in it would be part of the data; "
                    "remove it, or name another folder"
                )
