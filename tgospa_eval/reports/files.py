"""The result as files: JSON, CSV tables, the report; whole or absent."""

import csv
import importlib.util
import io
import os
from collections.abc import Mapping
from pathlib import Path

from tgospa_eval.errors import ConfigError
from tgospa_eval.summary import Summary, Table


def json_text(result: Summary) -> str:
    """The JSON document."""
    return result.to_json()


def per_step_csv(result: Summary) -> str:
    """The table of costs by step."""
    return csv_text(result.per_step_table())


def csv_text(table: Table) -> str:
    """A table as CSV; None is an empty field, numbers are full doubles."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*table.values(), strict=True))
    return text.getvalue()


def check_folder(folder: str, *, force: bool, option: str = "--output") -> None:
    """See that a folder can be written, before any work is done; `option` is for messages.

    Raises
    ------
    ConfigError
        It is a file, or not empty and `force` is not set.
    """
    if not folder:
        raise ConfigError(f"{option} is empty; name a folder")
    path = Path(folder)
    try:
        if path.exists() and not path.is_dir():
            raise ConfigError(f"{option} {folder}: is a file; name a folder")
        if path.is_dir() and not force and any(path.iterdir()):
            raise ConfigError(f"{option} {folder}: is not empty; name another folder, or --force")
    except OSError as error:
        raise ConfigError(f"{option} {folder}: {error.strerror}") from None


def probe_folder(folder: str, *, force: bool, option: str = "--output") -> None:
    """`check_folder`, and see that files can be made where `write_texts` will make them.

    Raises
    ------
    ConfigError
        As for `check_folder`, or nothing can be written there.
    """
    import tempfile

    check_folder(folder, force=force, option=option)
    path = Path(folder).absolute()
    there = next(above for above in path.parents if above.exists())
    try:
        for place in (there, path) if path.exists() else (there,):
            os.rmdir(tempfile.mkdtemp(prefix=f".{path.name}-", dir=place))
    except OSError as error:
        raise ConfigError(f"{option} {folder}: cannot be written: {error.strerror}") from None


def write_folder(
    result: Summary,
    folder: str,
    *,
    force: bool,
    names: tuple[str, str] = ("truth", "estimate"),
    more: Mapping[str, bytes] | None = None,
) -> tuple[str, ...]:
    """Write the result folder.

    Parameters
    ----------
    result : Summary
        What to write.
    folder : str
        Where.
    force : bool
        Whether it may hold files already.
    names : pair of str
        What truth and estimate are called in the report.
    more : mapping of str to bytes, optional
        Further files by name.

    Returns
    -------
    tuple of str
        Extras that are not installed, without which a part is not written.

    Raises
    ------
    ConfigError
        The folder cannot be written.
    """
    check_folder(folder, force=force)
    texts: dict[str, str | bytes] = {
        "result.json": result.to_json(),
        "per_step.csv": per_step_csv(result),
        "assignments.csv": csv_text(result.assignments_table()),
        "switches.csv": csv_text(result.switches_table()),
        "per_truth.csv": csv_text(result.per_truth_table()),
        "per_estimate.csv": csv_text(result.per_estimate_table()),
        "timings.csv": csv_text(_timings(result)),
    }
    if result.traced is not None:
        texts["curve.csv"] = csv_text(result.curve_table())
    if result.per_class_table():
        texts["per_class.csv"] = csv_text(result.per_class_table())
    missing: tuple[str, ...] = ()
    if importlib.util.find_spec("jinja2") is None:
        missing = ("report",)
    else:
        from tgospa_eval.reports.html import page

        texts["report.html"] = page(result, names)
    write_texts(texts | dict(more or {}), folder, force=force)
    return missing


def write_texts(
    texts: Mapping[str, str | bytes], folder: str, *, force: bool, option: str = "--output"
) -> None:
    """Write the files of a folder: every file beside first, then renamed.

    Raises
    ------
    ConfigError
        The folder cannot be written.
    """
    import shutil  # here, with tempfile: they bring compression and random numbers
    import tempfile

    check_folder(folder, force=force, option=option)
    path = Path(folder).absolute()
    beside: str | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent)
        for name, text in texts.items():
            content = text if isinstance(text, bytes) else text.encode("utf-8")
            (Path(beside) / name).write_bytes(content)
        path.mkdir(exist_ok=True)
        for name in texts:
            os.replace(Path(beside) / name, path / name)
    except OSError as error:
        raise ConfigError(f"{option} {folder}: cannot be written: {error.strerror}") from None
    finally:
        if beside is not None:
            shutil.rmtree(beside, ignore_errors=True)


def check_file(path: str, *, force: bool, option: str) -> None:
    """Whether a file may be written there.

    Raises
    ------
    ConfigError
        It exists, or its folder does not.
    """
    if Path(path).is_dir():
        raise ConfigError(f"{option} {path}: is a folder; name a file")
    if not force and Path(path).exists():
        raise ConfigError(f"{option} {path}: exists; name another file, or --force")
    if not Path(path).absolute().parent.is_dir():
        raise ConfigError(f"{option} {path}: there is no such folder; make it first")


def write_file(path: str, data: str | bytes, option: str) -> None:
    """Write a file beside first, then rename it; `option` is for messages.

    Raises
    ------
    ConfigError
        It cannot be written.
    """
    if not path:
        raise ConfigError(f"{option} is empty; name a file")
    content = data.encode() if isinstance(data, str) else data
    target = Path(os.path.realpath(path))  # what a link points to, and not the link, is replaced
    beside = target.with_name(f".{target.name}-{os.getpid()}-{os.urandom(4).hex()}")
    try:
        if target.is_dir():
            raise ConfigError(f"{option} {path}: is a folder; name a file")
        if target.exists() and not target.is_file():  # a device or a pipe: nothing to rename over
            target.write_bytes(content)
            return
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            # Not by tempfile, whose files nobody else may read: CI has many users.
            with beside.open("xb") as file:
                file.write(content)
            if target.exists():
                beside.chmod(target.stat().st_mode & 0o7777)
            os.replace(beside, target)
        finally:
            beside.unlink(missing_ok=True)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f"{option} {path}: cannot be written: {reason}") from None


def _timings(result: Summary) -> Table:
    flat = {k: v for k, v in result.timings.items() if k not in ("solve", "nanoseconds_per_state")}
    flat |= {f"solve/{name}": seconds for name, seconds in result.timings["solve"].items()}
    return {"stage": list(flat), "seconds": list(flat.values())}
