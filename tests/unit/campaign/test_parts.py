"""Parts of a store: many are made one, and nobody who reads meanwhile notices."""

import errno
from pathlib import Path
from typing import Any

import pytest

from tgospa_eval.campaign import store as module
from tgospa_eval.campaign.store import SCHEMA, Store
from tgospa_eval.errors import ConfigError, InputError


def row(key: int, status: str = "done", **more: object) -> dict[str, Any]:
    base = {"key": str(key), "status": status, "finished": key, "label.run": str(key)}
    return base | {"truth": "t", "estimate": "e", "options": "{}"} | more


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """One with parts of other columns each."""
    store = Store(str(tmp_path / "s"))
    store.open({"schema": SCHEMA})
    store.add([row(1, "failed", message="no file")])
    store.add([row(2, tgospa=2.5, message=None)])
    store.add([row(1, tgospa=1.5), row(3, tgospa=3.5)])
    return store


def names(store: Store) -> list[str]:
    return sorted(path.name for path in (store.folder / "jobs").iterdir())


def test_many_parts_become_one(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    before = store.rows()
    assert before["tgospa"].tolist() == [1.5, 2.5, 3.5]
    store.join()
    assert len(names(store)) == 3
    monkeypatch.setattr(module, "MANY_PARTS", 2)
    store.join()
    assert len(names(store)) == 1
    assert store.rows().equals(before)


def test_joining_that_is_broken_off_loses_nothing(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = store.rows()
    monkeypatch.setattr(module, "MANY_PARTS", 2)
    removed: list[Path] = []

    def killed(path: Path, missing_ok: bool = False) -> None:
        if missing_ok:  # of what was written beside
            return
        removed.append(path)
        if len(removed) == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(Path, "unlink", killed)
        with pytest.raises(KeyboardInterrupt):
            store.join()
    assert len(names(store)) == 4
    assert store.rows().equals(before)
    store.join()
    assert len(names(store)) == 1
    assert store.rows().equals(before)


def test_who_reads_while_parts_are_joined_reads_again(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, listed = store.rows(), store._parts()
    monkeypatch.setattr(module, "MANY_PARTS", 2)
    store.join()
    answers = [listed, store._parts()]
    monkeypatch.setattr(store, "_parts", lambda: answers.pop(0))
    assert store.rows().equals(before)


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
