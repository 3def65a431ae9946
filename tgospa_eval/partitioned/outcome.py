"""What the shards found, as the tables of a result."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.partitioned.by_time import Part, parts_of, write_all_switches, write_part
from tgospa_eval.partitioned.tables import Naming, write_per_step, write_tracks
from tgospa_eval.partitioned.tasks import run_tasks
from tgospa_eval.problem.problem import Floats, Ints
from tgospa_eval.problem.solution import Breakdown
from tgospa_eval.results.partitioned import IN_PARTS, StoredTables, name_of


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackSums:
    """What the k tracks of one side contribute.

    Parameters
    ----------
    rows : (k,) int array
        At how many steps each exists.
    parts : mapping of str to (k,) float array
        In units of c^p, by the names of `problem.readout.PerTrack`.
    """

    rows: Ints
    parts: Mapping[str, Floats]


def write_tables(
    folder: str,
    naming: Naming,
    split: Breakdown,
    tracks: tuple[TrackSums, TrackSums],
    shards: Sequence[Path],
    run: Callable[[Callable[[Part], None], Sequence[Part]], None] = run_tasks,
    *,
    assignments: bool = True,
) -> StoredTables:
    """Write all tables, those that are not there yet.

    Parameters
    ----------
    folder : str
        Where; its parent gets a folder `names` beside it.
    naming : Naming
        Times and ids.
    split : Breakdown
        Of the whole.
    tracks : pair of TrackSums
        Of truths and estimates.
    shards : sequence of Path
        Folders with ``assigned.npy`` and ``switched.npy``, each by time.
    run : callable
        Does tasks.
    assignments : bool
        Whether the table of assigned pairs is wanted, which is as long as the data; else it has no
        rows.

    Raises
    ------
    ConfigError
        They cannot be written, or pyarrow is not installed.
    """
    place = Path(folder)
    names = str(place.parent / "names")
    if not Path(names).exists():
        naming.save(names)

    def missing(table: str) -> str | None:
        path = place / name_of(table)
        return None if path.exists() else str(path)

    if path := missing("per_step"):
        write_per_step(path, split, naming)
    if path := missing("per_truth"):
        write_tracks(path, "missed", tracks[0].rows, tracks[0].parts, naming)
    if path := missing("per_estimate"):
        write_tracks(path, "false", tracks[1].rows, tracks[1].parts, naming)
    if path := missing("switches"):
        write_all_switches(path, [shard / "switched.npy" for shard in shards], naming)
    pieces = [shard / "assigned.npy" for shard in shards if assignments]
    parts = str(place / name_of(IN_PARTS))
    run(write_part, parts_of(parts, pieces, len(naming.times), names, naming.parameters))
    return StoredTables(folder)
