"""Settings from files and from the environment: who wins, and what is refused."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from answer import Invoke

from tgospa_eval.cli.shared.command import TRUSTED_KEYS, Option
from tgospa_eval.cli.verbs import VERBS, load


@pytest.fixture
def scene(tmp_path: Path) -> list[str]:
    """Two files and the options under which the parameters can be read."""
    for name in ("t.csv", "e.csv"):
        (tmp_path / name).write_text("id,t,x,y\na,1,2,3\n", encoding="utf-8")
    return ["t.csv", "e.csv", "--format", "json"]


@pytest.fixture
def settings(tmp_path: Path) -> Callable[[str, str], None]:
    """Write a settings file into the current folder of the run."""

    def write(name: str, text: str) -> None:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")

    return write


Settings = Callable[[str, str], None]


def parameters(answer: Any) -> dict[str, Any]:
    """The parameters of a run that went well."""
    assert answer.status == 0, answer.err
    found: dict[str, Any] = json.loads(answer.out)["parameters"]
    return found


def test_flag_before_environment_before_file_before_default(
    invoke: Invoke, scene: list[str], settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cutoff(*more: str) -> float:
        value: float = parameters(invoke(*scene, *more))["cutoff"]
        return value

    assert cutoff() == 10
    settings("pyproject.toml", "[tool.tgospa-eval]\ncutoff = 3\n")
    assert cutoff() == 3
    settings("tgospa-eval.toml", "cutoff = 4\n")
    assert cutoff() == 4
    settings("other.toml", "cutoff = 5\n")
    assert cutoff("--config", "other.toml") == 5
    monkeypatch.setenv("TGOSPA_EVAL_CUTOFF", "6")
    assert cutoff() == 6
    assert cutoff("--config", "other.toml") == 6
    assert cutoff("-c", "7", "--config", "other.toml") == 7
    # Also when the flag says what the default says.
    assert cutoff("-c", "10") == 10


def test_every_source_counts_as_given(
    invoke: Invoke, scene: list[str], settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "default cutoff" in invoke(*scene).err
    settings("tgospa-eval.toml", "cutoff = 10.0\n")
    monkeypatch.setenv("TGOSPA_EVAL_SWITCH_PENALTY", "2")
    assert "default" not in invoke(*scene).err


@pytest.mark.parametrize(
    ("text", "name", "value"),
    [
        ("order = 1", "order", 1),
        ("switch-penalty = 0.5", "switch_penalty", 0.5),
        ("switch_penalty = 0.5", "switch_penalty", 0.5),
        ('distance = "manhattan"', "distance", "manhattan"),
        ('columns = "y,x"', "columns", ["y", "x"]),
        ('columns = ["y", "x"]', "columns", ["y", "x"]),
        ('on-duplicate = "last"', "on_duplicate", "last"),
        ('unit = "m"', "unit", "m"),
    ],
)
def test_keys_are_the_options(
    invoke: Invoke, scene: list[str], settings: Settings, text: str, name: str, value: Any
) -> None:
    settings("tgospa-eval.toml", text)
    assert parameters(invoke(*scene))[name] == value


def test_gamma_is_the_switch_penalty(
    invoke: Invoke, scene: list[str], settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings("tgospa-eval.toml", "gamma = 3")
    assert parameters(invoke(*scene))["switch_penalty"] == 3
    monkeypatch.setenv("TGOSPA_EVAL_GAMMA", "4")
    assert parameters(invoke(*scene))["switch_penalty"] == 4
    assert parameters(invoke(*scene, "--gamma", "5"))["switch_penalty"] == 5
    settings("tgospa-eval.toml", "gamma = 3\nswitch-penalty = 3")
    assert '"switch-penalty" is given twice' in invoke(*scene).err


def test_keys_that_are_no_parameters(
    invoke: Invoke, scene: list[str], settings: Settings, tmp_path: Path
) -> None:
    settings("ours.toml", 'format = "csv"\noutput = "out"\nforce = true\nquiet = true\n')
    settings("out/notes.txt", "mine")
    status, out, err = invoke("t.csv", "e.csv", "--config", "ours.toml")
    assert (status, err) == (0, "")
    assert out.startswith("t,localisation,")
    assert (tmp_path / "out" / "result.json").exists()


def test_environment(
    invoke: Invoke, scene: list[str], settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TGOSPA_EVAL_SWITCH_PENALTY", "0.25")
    monkeypatch.setenv("TGOSPA_EVAL_ON_DUPLICATE", "first")
    found = parameters(invoke(*scene))
    assert (found["switch_penalty"], found["on_duplicate"]) == (0.25, "first")
    settings("mine.toml", "order = 1\n")
    monkeypatch.setenv("TGOSPA_EVAL_CONFIG", "mine.toml")
    answer = invoke(*scene)
    assert parameters(answer)["order"] == 1
    assert "mine.toml" in answer.err
    monkeypatch.setenv("TGOSPA_EVAL_ORDER", "two")
    answer = invoke(*scene)
    assert answer.status == 2
    assert "two" in answer.err


@pytest.mark.parametrize(
    ("name", "text", "arguments"),
    [
        ("tgospa-eval.toml", "cutoff = 3", []),
        ("pyproject.toml", "[tool.tgospa-eval]\ncutoff = 3", []),
        ("ci/other.toml", "cutoff = 3", ["--config", "ci/other.toml"]),
        ("ci/pyproject.toml", "[tool.tgospa-eval]\ncutoff = 3", ["--config", "ci/pyproject.toml"]),
    ],
)
def test_the_file_in_use_is_named(
    invoke: Invoke,
    scene: list[str],
    settings: Settings,
    name: str,
    text: str,
    arguments: list[str],
) -> None:
    settings(name, text)
    answer = invoke(*scene, *arguments)
    assert parameters(answer)["cutoff"] == 3
    assert f"settings from {name}: cutoff = 3\n" in answer.err
    used = {"path": name, "named": bool(arguments), "options": {"cutoff": 3}}
    assert json.loads(answer.out)["settings_file"] == used
    quiet = invoke(*scene, *arguments, "-q")
    # Of a file that nobody named it is said all the same.
    assert quiet.err == ("" if arguments else f"settings from {name}: cutoff = 3\n")
    assert json.loads(quiet.out)["settings_file"] == used


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[project]\nname = 'x'\n",
        "[tool.ruff]\ncutoff = 3\n",
        "not TOML",
        "tool = 3",
        "[project]\nname = 'tgospa-eval'\n",
        "tgospa-eval, not TOML",
        "tool = 'tgospa-eval'",
    ],
)
def test_a_pyproject_of_others_is_not_ours(
    invoke: Invoke, scene: list[str], settings: Settings, text: str
) -> None:
    settings("pyproject.toml", text)
    answer = invoke(*scene)
    assert parameters(answer)["cutoff"] == 10
    assert "pyproject" not in answer.err


@pytest.mark.parametrize(
    ("name", "text", "parts"),
    [
        ("tgospa-eval.toml", "cutof = 3", ['unknown key "cutof"; did you mean cutoff?']),
        ("tgospa-eval.toml", "cutoff = 3\nconfig = 'a'", ['unknown key "config"']),
        ("pyproject.toml", "[tool.tgospa-eval]\ntruth = 'a'", ['unknown key "truth"']),
        ("tgospa-eval.toml", "cutoff = 3\norder = ,", ["TOML", "line 2"]),
        ("tgospa-eval.toml", "[cutoff]\na = 3", ['"cutoff"', "table"]),
        ("pyproject.toml", "[tool]\ntgospa-eval = 3", ["tgospa-eval", "table"]),
    ],
)
def test_refused(
    invoke: Invoke, scene: list[str], settings: Settings, name: str, text: str, parts: list[str]
) -> None:
    settings(name, text)
    status, out, err = invoke(*scene)
    assert (status, out) == (2, "")
    for part in (f"{name}: ", *parts):
        assert part in err


@pytest.mark.parametrize("content", [None, b"cutoff = 3\n# \xff\n"])
def test_a_named_file_must_be_readable(
    invoke: Invoke, scene: list[str], tmp_path: Path, content: bytes | None
) -> None:
    if content is not None:
        (tmp_path / "mine.toml").write_bytes(content)
    for path in ("mine.toml", "."):
        status, out, err = invoke(*scene, "--config", path)
        assert (status, out) == (2, "")
        assert err.startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("cutoff = -3", ["cutoff is -3"]),
        ("cutoff = 'three'", ["--cutoff", "three"]),
        ("cutoff = true", ["cutoff"]),
        ("cutoff = nan", ["cutoff is nan"]),
        ("grid = 'magic'", ["magic", "union"]),
        ("grid = 3", ["3", "union"]),
        ("fix-cov = 'maybe'", ["maybe"]),
    ],
)
def test_bad_values(
    invoke: Invoke, scene: list[str], settings: Settings, text: str, parts: list[str]
) -> None:
    settings("tgospa-eval.toml", text)
    status, out, err = invoke(*scene)
    assert (status, out) == (2, "")
    for part in parts:
        assert part in err


@pytest.mark.parametrize("text", ["cutoff = -3", "cutoff = 'three'"])
def test_the_file_with_a_bad_value_is_named(
    invoke: Invoke, scene: list[str], settings: Settings, text: str
) -> None:
    settings("tgospa-eval.toml", text)
    # The command line shows nothing of it.
    assert "tgospa-eval.toml" in invoke(*scene).err


def test_help_does_not_need_a_good_file(invoke: Invoke, settings: Settings) -> None:
    settings("tgospa-eval.toml", "oops")
    assert invoke("--help").status == 0
    assert invoke("evaluate", "--help").status == 0
    assert invoke("--version").status == 0


NOT_TRUSTED = {
    *("output", "force", "junit", "github", "format", "pictures", "style", "components", "plane"),
    *("quiet", "verbose", "config"),
    *("scheduler", "memory", "max-input", "jobs", "no-gating"),
    *("solver", "gap", "epsilon", "time-limit"),
    *("baseline", "suite", "fail-on", "warn-on", "max"),
}
"""Keys that a file may not set which was only found."""


def test_every_key_is_trusted_or_not() -> None:
    options = [item for verb in VERBS for item in load(verb).params if isinstance(item, Option)]
    keys = {item.key for item in options if item.envvar}
    # Which files are read depends on --against: the environment alone may set it.
    assert keys - {"against"} == TRUSTED_KEYS | NOT_TRUSTED
    assert not TRUSTED_KEYS & NOT_TRUSTED


@pytest.mark.parametrize("key", sorted(NOT_TRUSTED - {"config", "memory", "scheduler"}))
@pytest.mark.parametrize("name", ["tgospa-eval.toml", "pyproject.toml"])
def test_a_file_that_was_found_sets_what_is_evaluated_alone(
    invoke: Invoke, scene: list[str], settings: Settings, tmp_path: Path, name: str, key: str
) -> None:
    flags = ("force", "github", "quiet", "verbose", "no-gating")
    head = "" if name == "tgospa-eval.toml" else "[tool.tgospa-eval]\n"
    value = "true" if key in flags else "'x'"
    settings(name, f"{head}cutoff = 3\n{key} = {value}\n")
    before = set(tmp_path.iterdir())
    for verb in ("evaluate", "gate", "compare", "explain", "inspect"):
        status, out, err = invoke(verb, "t.csv", "e.csv")
        assert (status, out) == (2, "")
        assert err == (
            f'{name}: only a file that you name may set "{key}"; if you trust this file, use '
            f"--config {name}\n"
        )
    assert set(tmp_path.iterdir()) == before


@pytest.mark.parametrize("text", ['scheduler = "tcp://127.0.0.1:1"', 'memory = "1TB"'])
def test_a_file_that_was_found_connects_to_nothing(
    invoke: Invoke, scene: list[str], settings: Settings, text: str
) -> None:
    settings("tgospa-eval.toml", text)
    answer = invoke(*scene)
    assert answer.status == 2
    assert "only a file that you name" in answer.err


def test_a_file_names_what_it_set_and_no_more(
    invoke: Invoke, scene: list[str], settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings(
        "tgospa-eval.toml", 'cutoff = 3\norder = 1\nrho = 0.4\nregion = "x=0:9"\nmixed = "error"'
    )
    monkeypatch.setenv("TGOSPA_EVAL_ORDER", "2")
    answer = invoke(*scene, "-c", "5")
    parameters(answer)
    set_by_it = {"rho": 0.4, "region": "x=0:9", "mixed": "error"}
    assert json.loads(answer.out)["settings_file"]["options"] == set_by_it
    told = 'settings from tgospa-eval.toml: rho = 0.4, region = "x=0:9", mixed = "error"\n'
    assert answer.err.startswith(told)
    settings("tgospa-eval.toml", "cutoff = 3\n")
    assert invoke(*scene, "-c", "5").err.startswith("no setting from tgospa-eval.toml\n")


def test_every_output_names_the_file(
    invoke: Invoke, scene: list[str], settings: Settings, tmp_path: Path
) -> None:
    told, used = 'settings from tgospa-eval.toml: region = "x=0:9"', {"region": "x=0:9"}
    settings("tgospa-eval.toml", 'region = "x=0:9"\n')
    for name, y in (("t.csv", 3), ("e.csv", 3), ("b.csv", 4)):
        settings(name, f"id,t,x,y,class\na,1,2,{y},car\n")
    two = ("t.csv", "e.csv")
    for line in (
        ("evaluate", *two),
        ("evaluate", *two, "--by", "class"),
        ("evaluate", *two, "--sweep", "gamma=1,2"),
        ("explain", *two),
        ("inspect", *two),
        ("compare", *two),
        ("compare", *two, "b.csv"),
        ("gate", *two, "--max", "tgospa=9"),
        ("associate", *two, "-c", "5"),
    ):
        answer = invoke(*line, "--format", "json", "-q")
        assert json.loads(answer.out)["settings_file"]["options"] == used, line
        assert answer.err == f"{told}\n"  # -q hides it only where somebody named the file
        if line[0] not in ("inspect", "associate"):
            shown = invoke(*line, "--format", "markdown", "-q").out
            assert told in shown.replace("\\", ""), line
    invoke("gate", *two, "--max", "tgospa=9", "--junit", "gate.xml", "-q")
    assert told.replace('"', "&#34;") in (tmp_path / "gate.xml").read_text(encoding="utf-8")
    assert told in invoke("gate", *two, "--max", "tgospa=9", "-q").out
    assert invoke(*two, "-o", "out", "--pictures", "none", "-q").status == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert told[1:].replace('"', "&#34;") in page
    jobs = ("batch", "--truth", "{run}.csv", "--estimate", "{run}.csv", "-o", "store", "--reports")
    assert told in invoke(*jobs, "--pictures", "none").err
    store = tmp_path / "store"
    for path in (store / "batch.json", store / "reports" / "t" / "result.json"):
        found = json.loads(path.read_text(encoding="utf-8"))
        assert found["settings_file"]["options"] == used
    page = (store / "report.html").read_text(encoding="utf-8")
    assert told.replace('"', "&#34;") in page
    assert told in " ".join(
        json.loads(invoke("batch", "report", "store", "--format", "json").out)["notes"]
    )
    # It sets nothing of stored results, which stay as they are.
    settings("tgospa-eval.toml", "cutoff = 50\n")
    saved = str(store / "reports" / "t"), str(store / "reports" / "e")
    for line in (("batch", "report", "store"), ("gate", "store", "store"), ("compare", *saved)):
        answer = invoke(*line, "--format", "json")
        assert "no setting from tgospa-eval.toml" in answer.err, line
        assert json.loads(answer.out).get("settings_file", {"options": {}})["options"] == {}, line
