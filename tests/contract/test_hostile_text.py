"""Hostile texts in every field that a user fills, and nothing of them live in any output."""

import csv
import io
import json
import re
import unicodedata
from pathlib import Path
from xml.etree import ElementTree as ET

import pandas as pd
import pytest
from answer import Invoke

import tgospa_eval

EVIL = (
    "::error::x\n::add-mask::y\r\n ::z:: ##[error]a ##vso[b]c\x1b]0;t\x07\x1b[2J\x9b2J\x7f"
    "\u202e\u2066\u2028<img src=x onerror=alert(1)>&<!-- *bold* _it_ |`$~^{}#@me "
    "\\input{x}%w -->"
)
"""Without what a file name, a list with commas or a mapping with = cannot hold."""

NAME = EVIL.replace("src=x onerror=alert(1)", "onerror")
FORMULA = "=cmd()" + EVIL

SGR = re.compile("\x1b\\[[0-9;]*m")
"""Colours, which a terminal gets."""


@pytest.fixture
def scene(tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Files whose names, ids, classes, columns and unit are hostile, in the current folder."""
    monkeypatch.setenv("CI", "1")
    side = "position" + NAME
    files = {}
    for role, moved in (("truth", 0), ("estimate", 1), ("other", 2)):
        rows = []
        for k, (name, kind) in enumerate(((FORMULA, "@" + EVIL), (EVIL, EVIL))):
            for t in range(5):
                swapped = k if role == "truth" or t < 3 else 1 - k
                rows.append((f"{name}{role}", t, 20.0 * swapped + moved, float(t), kind, "n"))
        files[role] = f"{role}{NAME}.parquet"
        # Of parquet, for a header of CSV is one line.
        frame = pd.DataFrame(rows, columns=["id", "t", side, "y", "class", "note" + NAME])
        frame.to_parquet(files[role])
    settings = {"unit": EVIL, "columns": f"{side},y", "cutoff": 5, "switch-penalty": 2}
    Path("tgospa-eval.toml").write_text(
        "".join(f"{key} = {json.dumps(value)}\n" for key, value in settings.items()).replace(
            "\x7f", "\\u007f"
        ),
        encoding="utf-8",
    )
    return files


def check_visible(text: str) -> None:
    """Nothing that a terminal or a CI system takes for a command."""
    for c in text:
        assert c in "\n\t" or unicodedata.category(c) not in ("Cc", "Cf", "Zl", "Zp", "Cs"), repr(c)
    assert "##[" not in text
    assert "##vso[" not in text
    assert not re.search(r"^\s*::", text, re.MULTILINE)


def check_markdown(text: str) -> None:
    """Nothing that is markup, but for what is within code."""
    prose = re.sub("`[^`\n]*`|<code>[^<\n]*</code>", "", text)
    assert "<img" not in prose
    assert "<!--" not in prose
    assert not re.search(r"(?<!\\)(\*bold|_it_|\$~|\|`)", prose)


def check_latex(text: str) -> None:
    """No command but those of a table; comments end where ours do."""
    live = [line for line in text.split("\n") if not line.startswith("% ")]
    known = (
        r"\\begin{tabular}{l?r*}|\\(begin|end){table\*?}|\\end{tabular}|\\(top|mid|bottom)rule"
        r"|\\centering|\\caption{|\\small\\setlength{\\tabcolsep}|\\underline{|\\ensuremath{\\gamma}"
        r"|\\text(bf{|backslash{}|ascii\w+{}|less{}|greater{})|\\[&%$#_{}]|\\\\$"
    )
    for line in live:
        assert "\\" not in re.sub(known, "", line), line
        assert not re.search(r"(?<!\\)[%$#_^~]", line), line


def check_csv(text: str) -> None:
    """No cell that a spreadsheet computes."""
    for row in csv.reader(io.StringIO(text)):
        for cell in row:
            assert not re.match(r"[=@\t\r]|[-+](?![\d.])", cell), cell


CHECKS = {"markdown": check_markdown, "latex": check_latex, "csv": check_csv, "json": json.loads}

EVALUATIONS = {
    "plain": (),
    "by class": ("--by", "class"),
    "sweep": ("--sweep", "cutoff=2,5"),
}


@pytest.mark.parametrize("format_", ["table", "json", "csv", "markdown", "latex"])
@pytest.mark.parametrize("more", EVALUATIONS.values(), ids=EVALUATIONS)
def test_evaluate(
    invoke: Invoke, scene: dict[str, str], more: tuple[str, ...], format_: str
) -> None:
    answer = invoke(scene["truth"], scene["estimate"], "--format", format_, *more)
    assert answer.status == 0, answer.err
    check_visible(answer.out)
    check_visible(answer.err)
    CHECKS.get(format_, check_visible)(answer.out)


def test_on_a_terminal(
    invoke: Invoke, scene: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    answer = invoke(scene["truth"], scene["estimate"], "--by", "class", "--curve")
    assert SGR.search(answer.out)
    check_visible(SGR.sub("", answer.out))


def test_a_program_gets_ids_as_they_are(
    invoke: Invoke, scene: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CI")
    pair = scene["truth"], scene["estimate"]
    answer = invoke("associate", *pair, "-c", "5", "--format", "csv")
    rows = list(csv.DictReader(io.StringIO(answer.out)))
    names = {row["id_a"] for row in rows}
    assert names == {f"'{FORMULA}truth", f"{EVIL}truth"}
    document = json.loads(invoke("associate", *pair, "-c", "5", "--format", "json").out)
    assert {row["id_a"] for row in document["associations"]} == {f"{FORMULA}truth", f"{EVIL}truth"}


@pytest.mark.parametrize("format_", ["table", "json", "csv"])
def test_associate(invoke: Invoke, scene: dict[str, str], format_: str) -> None:
    answer = invoke("associate", scene["truth"], scene["estimate"], "-c", "5", "--format", format_)
    assert answer.status == 0, answer.err
    check_visible(answer.out)
    check_visible(answer.err)
    CHECKS.get(format_, check_visible)(answer.out)


@pytest.mark.parametrize("format_", ["table", "json"])
def test_inspect(invoke: Invoke, scene: dict[str, str], format_: str) -> None:
    answer = invoke("inspect", scene["truth"], scene["estimate"], "--format", format_)
    assert answer.status == 0, answer.err
    check_visible(answer.out)
    check_visible(answer.err)


@pytest.mark.parametrize("format_", ["table", "json", "csv", "markdown", "latex"])
@pytest.mark.parametrize("others", [("estimate",), ("estimate", "other")], ids=["1", "2"])
def test_compare(
    invoke: Invoke, scene: dict[str, str], others: tuple[str, ...], format_: str
) -> None:
    files = [scene[name] for name in ("truth", *others)]
    solvers = ("--solvers", "certified") if len(files) == 3 else ("--solvers", "certified,sinkhorn")
    answer = invoke("compare", *files, "--format", format_, *solvers, "--epsilon", "0.1")
    assert answer.status == 0, answer.err
    check_visible(answer.out)
    check_visible(answer.err)
    CHECKS.get(format_, check_visible)(answer.out)


def test_folders(invoke: Invoke, scene: dict[str, str]) -> None:
    evaluated = invoke(scene["truth"], scene["estimate"], "-o", "result" + NAME, "--by", "class")
    compared = invoke("compare", *scene.values(), "-o", "ranks" + NAME)
    associated = invoke(
        "associate", scene["truth"], scene["estimate"], "-c", "5", "-o", "pairs" + NAME
    )
    for answer in (evaluated, compared, associated):
        assert answer.status == 0, answer.err
        check_visible(answer.err)
    files = [
        file for folder in ("result", "ranks", "pairs") for file in Path(folder + NAME).iterdir()
    ]
    names = {file.name for file in files}
    assert {"result.json", "report.html", "assignments.csv", "per_class.csv", "pairs.csv"} <= names
    for file in files:
        if file.suffix == ".csv":
            check_csv(file.read_text(encoding="utf-8"))
        elif file.suffix == ".html":
            text = file.read_text(encoding="utf-8")
            assert "<img" not in text
            assert "<!-- *bold" not in text
            assert "default-src 'none'" in text
        elif file.suffix == ".json":
            check_visible(file.read_text(encoding="utf-8").replace("\x7f", "").replace("##", ""))


def test_gate(invoke: Invoke, scene: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", "summary.md")
    pairs = {
        "ok" + EVIL: (scene["truth"], scene["estimate"]),
        EVIL: (scene["truth"], scene["truth"]),
        "gone" + EVIL: (scene["truth"], "none" + NAME),
    }
    text = "".join(
        f"[[pair]]\nname = {json.dumps(name)}\n"
        + "".join(
            f"{role} = {json.dumps(path)}\n"
            for role, path in zip(("truth", "estimate"), files, strict=True)
        )
        for name, files in pairs.items()
    ).replace("\x7f", "\\u007f")
    Path("suite.toml").write_text(text, encoding="utf-8")
    gate = ("gate", "--suite", "suite.toml", "--baseline", "base" + NAME)
    without = text[: text.rindex("[[pair]]")]
    Path("suite.toml").write_text(without, encoding="utf-8")
    made = invoke(*gate, "--update-baseline")
    assert made.status == 0, made.err
    check_visible(made.out + made.err)
    Path("suite.toml").write_text(text, encoding="utf-8")
    estimate = Path(scene["estimate"]).absolute()
    frame = pd.read_parquet(estimate)
    frame[frame.t > 0].to_parquet(estimate)
    for format_ in ("table", "json", "markdown"):
        answer = invoke(*gate, "--format", format_, "--github", "--junit", "junit.xml")
        assert answer.status == 1, answer.err
        check_visible(answer.out)
        CHECKS.get(format_, check_visible)(answer.out)
        ours = [line for line in answer.err.split("\n") if line.startswith("::")]
        assert ours
        for line in ours:
            assert line.startswith(("::error title=TGOSPA gate", "::warning title=TGOSPA gate"))
        check_visible("\n".join(re.sub("^::|%0A", "", line) for line in answer.err.split("\n")))
    check_markdown(Path("summary.md").read_text(encoding="utf-8"))
    check_visible(Path("summary.md").read_text(encoding="utf-8"))
    junit = ET.parse("junit.xml")
    for element in junit.iter():
        for value in (element.text or "", *element.attrib.values()):
            check_visible(value)


def test_simulate(invoke: Invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CI", "1")
    answer = invoke("simulate", NAME, "--steps", "5")
    assert answer.status == 0
    assert answer.out.count("\n") == 2
    check_visible(answer.out + answer.err)


def test_warnings_in_python(scene: dict[str, str]) -> None:
    frames = [pd.read_parquet(Path(scene[role]).absolute()) for role in ("truth", "estimate")]
    for frame in frames:
        frame.columns = ["id", "t", "x", "y", "class", "note"]
    frames[1].loc[:, ["x", "y"]] *= 1000
    with pytest.warns(tgospa_eval.TgospaWarning) as caught:
        result = tgospa_eval.evaluate(*frames, 5, 2, 2, unit=EVIL)
    for text in (*map(str, (item.message for item in caught)), str(result), repr(result)):
        check_visible(text)
    assert "<img" not in result._repr_html_()


WRONG = {
    "option": ("{truth}", "{estimate}", "--frobnicate" + NAME),
    "value": ("{truth}", "{estimate}", "--cutoff", EVIL),
    "choice": ("{truth}", "{estimate}", "--distance", EVIL),
    "class": ("{truth}", "{estimate}", "--class", "no" + EVIL),
    "time": ("{truth}", "{estimate}", "--time", EVIL),
    "region": ("{truth}", "{estimate}", "--region", NAME + "=1:2"),
    "columns": ("{truth}", "{estimate}", "--columns", NAME),
    "scale": ("{truth}", "{estimate}", "--scale", NAME + "=1"),
    "sweep": ("{truth}", "{estimate}", "--sweep", EVIL),
    "file": ("none" + NAME, "{estimate}"),
    "baseline": ("gate", "{truth}", "{estimate}", "--baseline", "{truth}"),
    "rule": ("gate", "{truth}", "{estimate}", "--baseline", "b.json", "--fail-on", EVIL),
    "suite": ("gate", "--suite", "{truth}", "--baseline", "b.json"),
    "config": ("{truth}", "{estimate}", "--config", "{truth}"),
    "solvers": ("compare", "{truth}", "{estimate}", "--solvers", EVIL),
    "log": ("compare", "--simulate", "-o", "study" + NAME, "--force"),
    "target": ("reduce", "{truth}", "out" + NAME, "-n", "3"),
}


@pytest.mark.parametrize("arguments", WRONG.values(), ids=WRONG)
def test_messages(invoke: Invoke, scene: dict[str, str], arguments: tuple[str, ...]) -> None:
    folder = Path("study" + NAME)
    folder.mkdir()
    (folder / "runs").mkdir()
    (folder / "runs/batch.json").write_text(json.dumps({EVIL: EVIL}), encoding="utf-8")
    typed = [
        scene.get(text.strip("{}"), text) if text.startswith("{") else text for text in arguments
    ]
    answer = invoke(*typed)
    assert answer.status in (2, 3), answer.err
    check_visible(answer.out + answer.err)


@pytest.mark.parametrize(
    "text",
    [
        f"{json.dumps(EVIL)} = 1\n",
        f"cutoff = {json.dumps(EVIL)}\n",
        f"distance = {json.dumps(EVIL)}\n",
        f"[{json.dumps(EVIL)}]\n",
        EVIL,
    ],
    ids=["key", "value", "choice", "table", "no TOML"],
)
def test_settings(invoke: Invoke, scene: dict[str, str], text: str) -> None:
    Path("tgospa-eval.toml").write_text(text.replace("\x7f", "\\u007f"), encoding="utf-8")
    answer = invoke(scene["truth"], scene["estimate"])
    assert answer.status == 2
    check_visible(answer.err)
