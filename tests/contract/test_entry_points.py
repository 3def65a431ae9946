"""A package that is installed beside this one adds a distance and a reader.

It is the example of docs/reference/extend.md, as that page has it.
"""

import json
import os
import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from answer import Run
from checkout import DOCS, ROOT

from tgospa_eval import ConfigError, InputError, evaluate, read_trajectories
from tgospa_eval.distances import DISTANCES
from tgospa_eval.formats import FORMATS

Install = Callable[..., Path]

# Two steps: 4 apart, of which the root is 2, and 0.
TRUTH, ESTIMATE = "a|0|0|0\na|1|0|0\n", "b|0|4|0\nb|1|0|0\n"
PARAMETERS = "-c", "3", "-p", "1", "-g", "1"
DISTANCE_GROUP, FORMAT_GROUP = "tgospa_eval.distances", "tgospa_eval.formats"


def example() -> tuple[str, dict[str, dict[str, str]]]:
    """The module and the entry points of the page."""
    page = (DOCS / "reference" / "extend.md").read_text(encoding="utf-8")
    module = re.findall(r"^```python\n(.*?)^```", page, re.M | re.S)[0]
    project = re.findall(r"^```toml\n(.*?)^```", page, re.M | re.S)[0]
    return module, tomllib.loads(project)["project"]["entry-points"]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Make a package as pip does, on the path of this process and of those that it starts."""

    def install(name: str, points: dict[str, dict[str, str]], module: str = "") -> Path:
        folder = tmp_path / f"site-{name}"
        info = folder / f"{name.replace('-', '_')}-1.0.dist-info"
        info.mkdir(parents=True)
        (folder / f"{name.replace('-', '_')}.py").write_text(module, encoding="utf-8")
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8"
        )
        lines = []
        for group, members in points.items():
            lines += [f"[{group}]", *(f"{key} = {place}" for key, place in members.items()), ""]
        (info / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
        monkeypatch.syspath_prepend(str(folder))
        (tmp_path / "truth.trk").write_text(TRUTH, encoding="utf-8")
        for path in ("estimate.trk", "other.trk"):
            (tmp_path / path).write_text(ESTIMATE, encoding="utf-8")
        return folder

    return install


@pytest.fixture
def mine(install: Install) -> Path:
    module, points = example()
    return install("mine", points, module)


def beside(folder: Path) -> dict[str, str]:
    """The environment of a process that finds a package."""
    return {"PYTHONPATH": os.pathsep.join((str(ROOT), str(folder)))}


PAIR = "truth.trk", "estimate.trk"
BY_NAME = *PARAMETERS, "--distance", "snowflake", "--format", "json"


def test_a_command_line_knows_both(run: Run, mine: Path) -> None:
    done = run(*PAIR, *BY_NAME, env=beside(mine))
    assert done.status == 0
    document = json.loads(done.out)
    assert document["total"] == 2.0  # the Euclidean distance, 4, is beyond the cutoff
    assert document["parameters"]["distance"] == "snowflake"
    assert "read as trk" in done.err
    assert (
        "--proof is not supported with --distance snowflake"
        in run(*PAIR, *BY_NAME[:-2], "-o", "out", "--proof", env=beside(mine)).err
    )


def test_help_names_both_and_imports_neither(run: Run, install: Install) -> None:
    folder = install("late", example()[1], "raise RuntimeError")
    text = " ".join(run("evaluate", "--help", env=beside(folder)).out.split())
    assert "max-sliced-wasserstein. Also snowflake." in text
    assert "yolo or csv-per-object. Also trk." in text
    assert "snowflake" not in run("evaluate", "--help").out


@pytest.mark.parametrize(
    "arguments",
    [
        ("associate", *PAIR, "-c", "3", "--distance", "snowflake", "--format", "json"),
        ("compare", *PAIR, "other.trk", *BY_NAME),
        ("gate", *PAIR, *BY_NAME, "--baseline", "base.json", "--update-baseline"),
        ("inspect", *PAIR, "-c", "3", "--distance", "snowflake", "--format", "json"),
        ("evaluate", *PAIR, *PARAMETERS, "--config", "set.toml", "--format", "json"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_every_verb_knows_both(
    invoke: Run, tmp_path: Path, mine: Path, arguments: tuple[str, ...]
) -> None:
    settings = 'distance = "snowflake"\ntruth-format = "trk"\n'
    (tmp_path / "set.toml").write_text(settings, encoding="utf-8")
    done = invoke(*arguments)
    assert done.status == 0, done.err
    text = done.out + "".join(path.read_text("utf-8") for path in tmp_path.glob("base.json"))
    assert '"distance": "snowflake"' in text


def test_processes_of_a_batch_know_both(run: Run, tmp_path: Path, mine: Path) -> None:
    rows = "".join(f"{k},{','.join(PAIR)}\n" for k in range(3))
    (tmp_path / "jobs.csv").write_text("sequence,truth,estimate\n" + rows, "utf-8")
    done = run(
        *(
            "batch",
            "jobs.csv",
            "-o",
            "out",
            *PARAMETERS,
            *BY_NAME[len(PARAMETERS) :],
            "--workers",
            "2",
        ),
        env=beside(mine),
    )
    assert done.status == 0, done.err
    assert '"distance": "snowflake"' in done.out
    assert '"total": 2.0' in done.out


def test_python_knows_both(mine: Path, tmp_path: Path) -> None:
    path = str(tmp_path / "estimate.trk")
    assert {"snowflake"} < {*DISTANCES}
    assert DISTANCES["snowflake"]([0.0, 0.0], [0.0, 9.0]) == 3
    for read in (read_trajectories(path), read_trajectories(path, format="trk")):
        assert read.state.tolist() == [[4, 0], [0, 0]]
    x = np.array([[[0.0, 0.0]], [[4.0, 0.0]]])
    result = evaluate(
        x[[0, 0]], x[[1, 0]], cutoff=3, order=1, switch_penalty=1, distance="snowflake"
    )
    assert result.total == 2
    assert result.parameters["distance"] == "snowflake"
    with pytest.raises(ConfigError, match='cannot hold the distance "snowflake"'):
        result.proof.save(tmp_path / "proof")
    with pytest.raises(ConfigError, match="periodic is for the norms"):
        evaluate(x, x, distance="snowflake", periodic=["x"])


def test_it_is_none_of_clouds(mine: Path) -> None:
    assert not DISTANCES["snowflake"].kinds
    assert [name for name in DISTANCES if "cloud" in DISTANCES[name].kinds] == [
        "cloud-wasserstein",
        "sliced-wasserstein",
        "max-sliced-wasserstein",
    ]
    x = np.zeros((1, 1, 2))
    with pytest.raises(ConfigError, match="reduce is for distances of clouds, not for snowflake"):
        evaluate(x, x, distance="snowflake", reduce=3)


BROKEN = """
from tgospa_eval.distances import Distance
import sys

class Crooked(Distance):
    name = "crooked"
    def between(self, components):
        return [1, 2, 3]
    def reach(self, cutoff, axes):
        return axes[:, :1] + cutoff

class Half(Distance):
    name = "half"

def number(path, data, options, role, **more):
    return 3

def fails(path, data, options, role, **more):
    raise KeyError("nothing")

def few(path, data, options, role, **more):
    import pandas
    return pandas.DataFrame({"id": ["a"], "x": [1.0]})

def leaves(path, data, options, role, **more):
    sys.exit(0)
"""


@pytest.mark.parametrize(
    ("name", "place", "reason"),
    [
        ("absent", "no_such_module:X", "ModuleNotFoundError"),
        ("nameless", "broken:X", "AttributeError"),
        ("module", "broken", "it is module, not a Distance"),
        ("number", "math:pi", "it is float, not a Distance"),
        ("other", "broken:Crooked", "its record has the name 'crooked'"),
        ("half", "broken:Half", "abstract"),
        ("crooked", "broken:Crooked", "Error: "),
    ],
)
def test_a_distance_that_does_not_work(
    invoke: Run, install: Install, quickstart: tuple[str, str], name: str, place: str, reason: str
) -> None:
    install("broken", {DISTANCE_GROUP: {name: place}}, BROKEN)
    done = invoke(*quickstart, "-c", "10", "-g", "5", "-q", "--distance", name)
    (line,) = done.err.splitlines()
    assert done.status == 2
    entry = f'the distance "{name}" of the package broken (entry point {name} = {place})'
    assert line.startswith(f"{entry} does not work: ")
    assert reason in line
    assert invoke(*quickstart, "-c", "10", "-g", "5", "-q").status == 0


@pytest.mark.parametrize(
    ("place", "status", "reason"),
    [
        ("no_such_module:X", 2, "ModuleNotFoundError"),
        ("math:pi", 2, "it is float, not a function"),
        ("broken:number", 3, "it returned int, not a DataFrame"),
        ("broken:fails", 3, "KeyError: 'nothing'"),
        ("broken:leaves", 3, "SystemExit"),
    ],
)
def test_a_reader_that_does_not_work(
    invoke: Run, install: Install, place: str, status: int, reason: str
) -> None:
    install("broken", {FORMAT_GROUP: {"trk": place}}, BROKEN)
    for chosen in ((), ("--truth-format", "trk")):
        done = invoke(*PAIR, "-q", *chosen)
        assert done.status == status
        for line in done.err.splitlines():  # one for each file
            assert f'the format "trk" of the package broken (entry point trk = {place})' in line
            assert reason in line


def test_a_table_without_a_column_is_wrong_input(install: Install, tmp_path: Path) -> None:
    install("broken", {FORMAT_GROUP: {"trk": "broken:few"}}, BROKEN)
    with pytest.raises(InputError, match=r"truth\.trk.*t.*missing|no column"):
        read_trajectories(tmp_path / "truth.trk")


def test_a_name_of_two_is_refused_where_it_is_used(
    invoke: Run, install: Install, quickstart: tuple[str, str]
) -> None:
    both = {DISTANCE_GROUP: {"euclidean": "x:X"}, FORMAT_GROUP: {"csv": "x:X", "tsv": "x:X"}}
    install("first", both)
    done = invoke(*quickstart, "-c", "10", "-g", "5", "-q", "--distance", "euclidean")
    assert done.status == 2
    assert '"euclidean" is provided by tgospa-eval and by the package first' in done.err
    done = invoke(*quickstart, "-c", "10", "-g", "5", "-q", "--truth-format", "csv")
    assert done.status == 2
    assert '"csv" is provided by tgospa-eval and by the package first' in done.err
    assert invoke(*quickstart, "-c", "10", "-g", "5", "-q").status == 0  # ours, without a doubt
    install("second", {DISTANCE_GROUP: {"thing": "x:X"}})
    install("third-one", {DISTANCE_GROUP: {"thing": "y:Y"}})
    with pytest.raises(ConfigError, match=r"the package third-one .*and by the package second"):
        DISTANCES.chosen("thing")


def test_endings_of_ours_stay_ours(install: Install, tmp_path: Path) -> None:
    install("greedy", {FORMAT_GROUP: {"tsv": "x:X", "parquet": "x:X"}})
    (tmp_path / "a.tsv").write_text("id\tt\tx\n1\t0\t5\n", encoding="utf-8")
    assert read_trajectories(tmp_path / "a.tsv").state.tolist() == [[5]]
    assert [*FORMATS][-1] == "tsv"
