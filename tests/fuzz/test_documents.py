"""Whatever becomes of a document of ours, who reads it answers with a sentence, no traceback.

Fields are taken away or replaced, texts are cut off; columns of tables likewise. The same few
cases run always, new ones by ``make fuzz``.
"""

import copy
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from answer import Invoke
from examples import examples
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

ROWS = [(name, t, x, 0, name * 2) for name, x in (("a", 0), ("b", 9)) for t in range(3)]
TRUTH = "id,t,x,y,class\n" + "".join(f"{i},{t},{x + t},{y},{c}\n" for i, t, x, y, c in ROWS)
ESTIMATE = TRUTH.replace("a,1,1", "c,1,1.5")
SIZES = ("--targets", "2", "--steps", "2", "--runs", "1", "--solvers", "certified")
OPTIONS = ("-c", "3", "-g", "1")
PAIR = ("t.csv", "e.csv", *OPTIONS)
STORE = (*OPTIONS, "--slice", "class", "--with", "clear", "--curve")

READERS: dict[str, tuple[tuple[str, ...], ...]] = {
    "a/result.json": (
        ("compare", "a", "b", "--format", "json"),
        ("compare", "a", "b", "-o", "out"),
    ),
    "c/result.json": (("compare", "c", "d"),),
    "a/.tgospa-eval.json": (("evaluate", *PAIR, "-q", "-o", "a"),),
    "s/batch.json": (
        ("batch", "report", "s"),
        ("gate", "s", "old"),
        ("batch", "m.csv", *STORE, "-q", "-o", "s", "--workers", "1"),
    ),
    "s/jobs": (
        ("batch", "report", "s", "--by", "run"),
        ("batch", "report", "s", "--format", "json"),
        ("gate", "s", "old", "--fail-on", "nees:+1%", "--warn-on", "counts.missed:+0"),
        ("batch", "m.csv", *STORE, "-q", "-o", "s", "--workers", "1"),
    ),
    "s/per_step": (
        ("batch", "report", "s", "--by", "run"),
        ("batch", "report", "s", "--band", "percentiles"),
    ),
    "base.json": (
        ("gate", "t.csv", "e.csv", "--baseline", "base.json"),
        ("gate", "t.csv", "e.csv", "--baseline", "base.json", "--update-baseline"),
        ("gate", "old", "--baseline", "base.json"),
    ),
    "study/runs/jobs": (("compare", "--simulate", *SIZES, *OPTIONS, "-q", "-o", "study"),),
}
"""The commands that read each document; of folders the tables in them."""

VALUES = (
    *(None, True, 0, -1, 1, 7, 2.5, 1e308, 10**400, 2**63, float("nan"), float("inf")),
    *("", "x", "1", "2024-01-01", "{}", "[1", "\ud800", [], [None], [1, 2], {}, {"x": 1}, [{}]),
)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The paths of all values in a document."""
    yield path
    if isinstance(value, dict | list):
        for name, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from places(item, (*path, name))


def changed(data: st.DataObject, document: Any) -> Any:
    """The document with one or two values replaced or taken away."""
    for _ in range(data.draw(st.integers(1, 2))):
        *way, last = ("", *data.draw(st.sampled_from(list(places(document)))))
        holder = {"": copy.deepcopy(document)}
        parent: Any = holder
        for name in way:
            parent = parent[name]
        change = data.draw(st.sampled_from(["drop", "value", "value", "value", "more", "twice"]))
        if change == "value" or not way:
            parent[last] = data.draw(st.sampled_from(VALUES))
        elif change == "drop":
            del parent[last]
        elif isinstance(parent, dict):
            parent["more" if change == "more" else f"{last}x"] = parent[last]
        else:
            parent.append(parent[last])
        document = holder[""]
    return document


def changed_text(data: st.DataObject, text: str) -> str:
    """A JSON text, or lines of such, with one changed or cut off."""
    if data.draw(st.integers(0, 9)) == 0:
        return text[: data.draw(st.integers(0, len(text) - 1))]
    try:
        return json.dumps(changed(data, json.loads(text)))
    except ValueError:
        lines = text.splitlines()
        at = data.draw(st.integers(0, len(lines) - 1))
        lines[at] = json.dumps(changed(data, json.loads(lines[at])))
        return "\n".join(lines) + "\n"


def changed_table(data: st.DataObject, path: Path) -> None:
    """A Parquet file with a column changed, or bytes cut off."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    table = pq.read_table(path)
    name = data.draw(st.sampled_from(table.column_names))
    at, values = table.column_names.index(name), table[name].to_pylist()
    change = data.draw(st.sampled_from(["drop", "one", "one", "one", "all", "text", "rows", "cut"]))
    if change == "cut":
        content = path.read_bytes()
        path.write_bytes(content[: data.draw(st.integers(0, len(content) - 1))])
        return
    if change == "drop":
        table = table.remove_column(at)
    elif change == "rows":
        rows = st.lists(st.integers(0, len(values) - 1), max_size=len(values) + 1)
        table = table.take(pa.array(data.draw(rows), pa.int64()))
    else:
        row = data.draw(st.integers(0, len(values) - 1))
        if change == "text" and isinstance(values[row], str):
            value: Any = changed_text(data, values[row]) if values[row][:1] in "[{" else "x"
        else:
            value = data.draw(st.sampled_from(VALUES))
        values = [value if change == "all" or k == row else own for k, own in enumerate(values)]
        try:
            column = pa.array(values)
        except (pa.ArrowException, OverflowError, UnicodeError, TypeError):
            column = pa.array([str(v).encode("ascii", "replace").decode() for v in values])
        table = table.set_column(at, name, column)
    with suppress(pa.ArrowException):  # what cannot be written
        pq.write_table(table, path)


@pytest.fixture(scope="module")
def documents(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one of each."""
    from tgospa_eval.cli import main

    def call(*arguments: str) -> None:
        with pytest.raises(SystemExit) as exit_:
            main(arguments)
        assert exit_.value.code in (0, 1)

    folder = tmp_path_factory.mktemp("documents")
    for name, text in (("t.csv", TRUTH), ("e.csv", ESTIMATE)):
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "m.csv").write_text("truth,estimate,run\nt.csv,e.csv,a\nt.csv,t.csv,b\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("TGOSPA_EVAL_PICTURES", "none")
        for name in ("a", "b", "c", "d"):
            more = ("--with", "clear") if name in "ab" else ("--by", "class")
            estimate = "e.csv" if name in "ac" else "t.csv"
            more = (*OPTIONS, "--slice", "class", "--curve", *more)
            call("evaluate", "t.csv", estimate, *more, "-q", "-o", name)
        call("batch", "m.csv", *STORE, "--per-step", "-q", "-o", "s", "--workers", "1")
        shutil.copytree("s", "old")
        judged = ("gate", "t.csv", "e.csv", "--baseline", "base.json")
        call(*judged, *OPTIONS, "--update-baseline")
        call("compare", "--simulate", *SIZES, *OPTIONS, "-q", "-o", "study")
    return folder


@pytest.mark.parametrize("name", READERS)
@settings(
    max_examples=examples(5),  # each is a command, or several of a store
    suppress_health_check=list(HealthCheck),
    phases=[Phase.explicit, Phase.generate],  # a smaller example would take minutes
)
@given(data=st.data())
def test_never_a_traceback(
    name: str, data: st.DataObject, documents: Path, tmp_path: Path, invoke: Invoke
) -> None:
    shutil.rmtree(tmp_path / "work", ignore_errors=True)
    shutil.copytree(documents, tmp_path / "work")
    os.chdir(tmp_path / "work")
    path = Path(name)
    if path.is_dir():
        changed_table(data, data.draw(st.sampled_from(sorted(path.glob("*.parquet")))))
    else:
        text = changed_text(data, path.read_text(encoding="utf-8"))
        path.write_text(text, encoding="utf-8", errors="surrogateescape")
    answer = invoke(*data.draw(st.sampled_from(READERS[name])))
    assert "internal error" not in answer.err
    assert answer.status in (0, 1, 2, 3, 4, 5)
    if answer.status in (2, 3) and not answer.out:
        assert answer.err.count("\n") == 1, answer.err
