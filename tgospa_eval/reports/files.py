"""The result as files: JSON and CSV tables, whole or absent."""

import csv
import io
import os
from collections.abc import Mapping
from pathlib import Path

from tgospa_eval.errors import ConfigError
from tgospa_eval.evaluation import Summary, Table


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


def write_folder(result: Summary, folder: str, *, force: bool) -> None:
    """Write the result folder.

    Raises
    ------
    ConfigError
        The folder cannot be written.
    """
    check_folder(folder, force=force)
    texts = {
        "result.json": result.to_json(),
        "per_step.csv": per_step_csv(result),
        "assignments.csv": csv_text(result.assignments_table()),
        "switches.csv": csv_text(result.switches_table()),
        "per_truth.csv": csv_text(result.per_truth_table()),
        "per_estimate.csv": csv_text(result.per_estimate_table()),
        "timings.csv": csv_text(_timings(result)),
    }
    if result.per_class_table():
        texts["per_class.csv"] = csv_text(result.per_class_table())
    write_texts(texts, folder, force=force)


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


def write_file(data: bytes, path: str, *, force: bool, option: str) -> None:
    """Write a file: beside first, then renamed.

    Raises
    ------
    ConfigError
        It cannot be written.
    """
    import tempfile

    check_file(path, force=force, option=option)
    target = Path(path).absolute()
    beside: str | None = None
    try:
        with tempfile.NamedTemporaryFile(
            prefix=f".{target.name}-", dir=target.parent, delete=False
        ) as file:
            beside = file.name
            file.write(data)
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(beside, 0o666 & ~mask)  # temporary files are for their owner alone
        os.replace(beside, target)
        beside = None
    except OSError as error:
        raise ConfigError(f"{option} {path}: cannot be written: {error.strerror}") from None
    finally:
        if beside is not None:
            Path(beside).unlink(missing_ok=True)


def _timings(result: Summary) -> Table:
    flat = {k: v for k, v in result.timings.items() if k not in ("solve", "nanoseconds_per_state")}
    flat |= {f"solve/{name}": seconds for name, seconds in result.timings["solve"].items()}
    return {"stage": list(flat), "seconds": list(flat.values())}
