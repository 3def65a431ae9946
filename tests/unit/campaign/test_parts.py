"""Parts of a store: they appear whole, and all are read as one."""

import errno
from pathlib import Path
from typing import Any

import pytest
from stored import settings_of, stored_row

from tgospa_eval.campaign.store import Store
from tgospa_eval.errors import ConfigError, InputError


def row(key: int, status: str = "done", **more: object) -> dict[str, Any]:
    return stored_row(str(key), status, key, **more)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """One with parts of other columns each."""
    store = Store(str(tmp_path / "s"))
    store.open(settings_of(5.0))
    store.add([row(1, "failed", message="no file")])
    store.add([row(2, seconds=2.5)])
    store.add([row(1, seconds=1.5), row(3, seconds=3.5)])
    return store


def names(store: Store) -> list[str]:
    return sorted(path.name for path in (store.folder / "jobs").iterdir())


def test_later_rows_of_a_job_count(store: Store) -> None:
    assert len(names(store)) == 3
    assert store.rows()["seconds"].tolist() == [1.5, 2.5, 3.5]


def test_a_damaged_part_is_named(store: Store) -> None:
    path = store.folder / "jobs" / names(store)[0]
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match=r"part-.*\.parquet: cannot be read"):
        store.rows()


def test_a_full_disk(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """What does not fit leaves nothing behind, and what was there before stays."""
    before, listed = store.rows(), names(store)

    def full(_: object, path: Path) -> None:
        path.write_bytes(b"PAR1")
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("pyarrow.parquet.write_table", full)
        with pytest.raises(ConfigError, match="cannot be written: No space left on device"):
            store.add([row(4)])
    assert names(store) == listed
    assert store.rows().equals(before)
    store.add([row(4)])
    assert len(store.rows()) == 4
