"""``evaluate`` of data in parts: progress, Ctrl-C, resuming and output."""

import hashlib
import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from tgospa_eval._version import __version__
from tgospa_eval.api.in_parts import evaluate_in_parts, jobs_of, memory_of
from tgospa_eval.api.notices import about_defaults, about_run
from tgospa_eval.api.options import Request
from tgospa_eval.api.resolve import resolve_request
from tgospa_eval.campaign.store import locked
from tgospa_eval.cli.evaluate.run import show
from tgospa_eval.cli.shared.click_builder import OutputOptions
from tgospa_eval.cli.shared.progress import bracket, new_stopwatch, shown
from tgospa_eval.cli.shared.streams import interrupted, notifier, print_notice
from tgospa_eval.cli.shared.writing import probed_folder
from tgospa_eval.common.documents import checked
from tgospa_eval.common.files import named
from tgospa_eval.common.progress import Progress
from tgospa_eval.common.writing import writing
from tgospa_eval.errors import ConfigError, InputError, MemoryTooSmallError
from tgospa_eval.partitioned.files import state_of, stored
from tgospa_eval.partitioned.run import SCANNED
from tgospa_eval.partitioned.tasks import removing
from tgospa_eval.results.partitioned import IN_PARTS, STORED_TABLES, name_of
from tgospa_eval.show.files import WORK_FOLDER, WORK_LOG

TABLE_FILES = (*map(name_of, STORED_TABLES[:-1]), f"{IN_PARTS}/part-00000.parquet")
"""Names of the tables in the folder of ``-o``. No other file in it can have such a name."""


def evaluate_parts(
    paths: tuple[str, str], options: Request, output: OutputOptions, why: str
) -> bool:
    """Evaluate data in parts, print and write; return whether the accuracy was reached.

    Parameters
    ----------
    paths : pair of str
        Truth and estimate.
    options, output : Request, OutputOptions
        What to evaluate, what to print and where to write; `check_parts` has accepted them.
    why : str
        Why the data are read in parts, for a notice.

    Raises
    ------
    TgospaError
        An option or the data are wrong.
    """
    # With its own allocators, Arrow keeps 20 MB more in each process. Workers inherit the variable.
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
    resolved = resolve_request(options)
    if output.output is not None:
        probed_folder(options, output, TABLE_FILES)
    stopwatch = new_stopwatch(quiet=output.quiet)
    if not output.quiet:
        print_notice(f"{why}: the data are read in parts")
        for text in about_defaults(options, boxes=False):
            print_notice(text)
    identity = identity_of(paths, options)
    if resolved.evaluation.ignoring is not None:
        identity |= resolved.evaluation.ignoring.recorded  # with the digest of a file of regions
    with work_folder(output, identity) as work:
        try:
            with shown(stopwatch, show=not output.quiet):
                result = evaluate_in_parts(
                    paths,
                    options,
                    resolved,
                    work,
                    stopwatch,
                    kept=output.output is not None,
                    pictures=output.output is not None,
                )
        except KeyboardInterrupt:
            print_notice(_interrupted(stopwatch.progress, output))
            raise
        result = replace(result, settings_file=output.config)
        notify = notifier(quiet=output.quiet)
        for notice in result.warnings:
            notify(notice)
        for text in about_run(result, resolved, stopwatch, verbose=output.verbose):
            print_notice(text)
        show(result, options, output, paths)
        return result.finished


def _interrupted(progress: Progress, output: OutputOptions) -> str:
    """Say which bracket is proven when work is interrupted, and how to resume the work."""
    proven = "" if progress.bracket is None else f"proven so far: {bracket(*progress.bracket)}; "
    if output.output is None:
        return f"{proven}with -o DIR finished parts are kept, and the same command resumes"
    kept = os.path.join(output.output, WORK_FOLDER)
    return f"{proven}finished parts are kept in {kept}; the same command resumes"


# -------------------------------------------------------------------------------------------------
# The folder of intermediate data. After an interruption, the same command goes on from it. At the
# end it is removed.


@contextmanager
def work_folder(output: OutputOptions, identity: Mapping[str, object]) -> Iterator[Path]:
    """Yield the path of the folder of intermediate data.

    It is in the folder of ``-o``, so that the work can be resumed. Without ``-o`` it is temporary.
    `identity` has the values that belong to this work, from `identity_of`.

    Raises
    ------
    ConfigError
        The folder has the work of another evaluation, or cannot be written.
    """
    if output.output is None:
        with tempfile.TemporaryDirectory(prefix="tgospa-eval-", ignore_cleanup_errors=True) as made:
            yield Path(made)
        return
    folder = Path(output.output)
    work = folder / WORK_FOLDER
    with named(f"--output {folder}", ConfigError, "cannot be written"):
        work.mkdir(parents=True, exist_ok=True)
    with locked(work, (0, 1), said=folder):
        _begin(work, identity, output)
        over = False
        try:
            yield work.absolute()  # workers of a cluster have other current folders
            over = not interrupted()  # after an interruption, no result was written
        except InputError:  # useful after a correction of the data only if they were scanned
            over = not (work / SCANNED).exists()
            raise
        except MemoryTooSmallError:
            over = True
            raise
        finally:
            if over:
                _remove(work)
    if over and work.exists():
        _remove(work)  # again, because Windows does not remove the lock while it is open


def _begin(work: Path, identity: Mapping[str, object], output: OutputOptions) -> None:
    """Go on with existing work if it is of this evaluation; otherwise prepare an empty folder.

    Raises
    ------
    ConfigError
        The folder has the work of another evaluation or other files, or cannot be written.
    """
    log, where = work.parent / WORK_LOG, f"--output {output.output}"
    with named(where, ConfigError, "cannot be written"):
        if log.exists():
            if _goes_on(log, identity, output, where):
                return
            _empty(work)
        elif any(not path.name.startswith(".") for path in work.iterdir()):
            raise ConfigError(
                f"{where}: it has a folder {WORK_FOLDER} that this program did not make; name "
                "another folder"
            )
        with writing(log, where) as beside:
            beside.write_text(json.dumps(identity, indent=1, sort_keys=True) + "\n", "utf-8")


def _empty(work: Path) -> None:
    """Remove all files of the work except the lock.

    Finished parts are renamed first, and the log is removed last. This order is safe: if the
    removal is interrupted, another evaluation cannot use a part of this work by mistake.

    Raises
    ------
    OSError
        A file cannot be moved.
    """
    log = work.parent / WORK_LOG
    with removing(work):
        log.unlink(missing_ok=True)


def _remove(work: Path) -> None:
    """Remove the folder of the work. Files that the system does not allow to remove stay there."""
    with suppress(OSError):
        _empty(work)
        for path in work.iterdir():
            path.unlink()
        work.rmdir()


def _goes_on(log: Path, identity: Mapping[str, object], output: OutputOptions, where: str) -> bool:
    """Return whether to go on with existing work; if false, the caller removes this work.

    It is true if options and data are the same as before. It is false if only the data changed, or
    if anything changed and ``--force`` is given.

    Raises
    ------
    ConfigError
        The work is of an evaluation with other options.
    """
    try:
        old = checked(log.read_bytes(), {})
    except ValueError:
        old = {}
    names = sorted({*old, *identity})
    differing = [name for name in names if old.get(name) != identity.get(name)]
    if not differing:
        if not output.quiet:
            print_notice(f"resuming with {log.parent}")
        return True
    if differing == ["data"] or output.force:
        if not output.quiet:
            only_data = differing == ["data"]
            what = "files that have changed since" if only_data else "other data or options"
            print_notice(f"{log.parent} belongs to {what}: starting again")
        return False
    texts = (
        f"{name.replace('_', '-')} was {json.dumps(old.get(name))}, is "
        f"{json.dumps(identity.get(name))}"
        for name in differing
        if name != "data"
    )
    raise ConfigError(
        f"{where}: {log.parent.name} in it belongs to an interrupted run with other options: "
        f"{'; '.join(texts)}; name another folder, or --force to delete it"
    )


def identity_of(paths: tuple[str, str], options: Request) -> dict[str, object]:
    """Return the values by which existing work is recognised, as JSON would read them.

    These are options, paths, version, limits, and a digest of names, sizes and times of the files.
    """
    sha = hashlib.sha256()
    for path in paths:
        for file, status in stored(path):
            sha.update(repr((file.path, *state_of(status))).encode("utf-8", "replace"))
    known: dict[str, object] = json.loads(json.dumps(options.given))
    return known | {
        "truth": paths[0],
        "estimate": paths[1],
        "data": sha.hexdigest(),
        "version": __version__,
        "memory": memory_of(options.memory),
        "jobs": None if options.scheduler else jobs_of(options),
    }
