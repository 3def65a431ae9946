"""Gates over stores of batches: two of them, or one and a file, or one as baseline of a suite."""

import json
import shutil
from pathlib import Path

import pytest
from answer import Invoke
from checkout import SAMPLES

from tgospa_eval import TgospaWarning, gate

PATTERNS = ("--truth", "gt/{run}.csv", "--estimate", "out/{tracker}/{run}.csv")


def rows(error: float) -> str:
    return "id,t,x,y\n" + "".join(f"1,{k},{k + error},0\n" for k in range(4))


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the store that every test begins with is kept once it is made."""
    return tmp_path_factory.mktemp("kept") / "old"


@pytest.fixture
def batch(kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, invoke: Invoke) -> Invoke:
    """Run a batch of two trackers with errors of 1 and 2, on two runs; `old` is one of them."""
    monkeypatch.chdir(tmp_path)
    for folder, error in (("gt", 0), ("out/a", 1), ("out/b", 2)):
        Path(folder).mkdir(parents=True)
        for run in "12":
            Path(folder, f"{run}.csv").write_text(rows(error), encoding="utf-8")

    def run(folder: str, *more: str, status: int = 0) -> None:
        given = ("-o", folder, "--workers", "1", "-q", *more)
        assert invoke("batch", *PATTERNS, *given).status == status

    if not kept.exists():
        run("old")
        shutil.copytree("old", kept)
    shutil.copytree(kept, "old", dirs_exist_ok=True)
    return run


def test_the_same_passes_and_a_worse_job_fails(batch: Invoke, invoke: Invoke) -> None:
    shutil.copytree("old", "same")
    answer = invoke("gate", "old", "same")
    assert answer.status == 0
    assert answer.out.startswith("gate: pass (exit status 0): 4 pass")
    Path("out/b/2.csv").write_text(rows(2.5), encoding="utf-8")
    batch("new")
    answer = invoke("gate", "old", "new", "--format", "json")
    assert answer.status == 1
    pairs = json.loads(answer.out)["pairs"]
    assert [(pair["name"], pair["verdict"]) for pair in pairs] == [
        ("a/1", "pass"), ("a/2", "pass"), ("b/1", "pass"), ("b/2", "fail")
    ]  # fmt: skip
    (rule,) = pairs[3]["rules"]
    assert (rule["baseline"], rule["lower"]) == (pytest.approx(16), pytest.approx(25))
    assert invoke("gate", "new", "--baseline", "old").out == invoke("gate", "old", "new").out
    assert invoke("gate", "old", "new", "--fail-on", "total:+60%").status == 0
    assert invoke("gate", "new", "--max", "tgospa=4.9").status == 1
    assert invoke("gate", "new", "--max", "tgospa=5.1").status == 0


def test_warnings_of_stored_jobs_are_in_every_output(batch: Invoke, invoke: Invoke) -> None:
    Path("out/a/1.csv").write_text("id,t,x,y\n", encoding="utf-8")
    batch("new")
    said = "a/1: warning: no row of the estimate is evaluated"
    answer = invoke("gate", "old", "new", "--fail-on", "total:+9999%", "-o", "g", "-q")
    assert said in answer.err
    page = Path("g/gate.html").read_text(encoding="utf-8")
    assert said.replace("warning: ", "") in page
    answer = invoke("gate", "new", "--baseline", "b.json", "--update-baseline", "-q")
    assert said in answer.err
    assert "a/1: misses all ground-truth states" in " ".join(answer.out.split())


def test_jobs_that_are_missing_or_failed_do_not_pass(batch: Invoke, invoke: Invoke) -> None:
    Path("out/b/2.csv").unlink()
    batch("fewer", "--allow-missing")
    answer = invoke("gate", "old", "fewer")
    assert answer.status == 2
    assert "b/2: in the baseline, but not in fewer\n" in answer.out
    answer = invoke("gate", "fewer", "old")
    assert (answer.status, "b/2: not in fewer" in answer.out) == (2, True)
    Path("out/b/2.csv").write_text("id,t\n1,2\n", encoding="utf-8")
    batch("failed", status=5)
    answer = invoke("gate", "old", "failed")
    assert answer.status == 3
    assert "b/2: failed in failed: out/b/2.csv, line 1: no column for position" in answer.err
    assert invoke("gate", "failed", "--baseline", "f.json", "--update-baseline").status == 3
    assert not Path("f.json").exists()
    assert invoke("gate", "failed", "old").status == 2


def test_another_truth_and_other_parameters_are_not_compared(batch: Invoke, invoke: Invoke) -> None:
    batch("other", "-c", "5")
    answer = invoke("gate", "old", "other")
    assert answer.status == 2
    assert "a/1, a/2, b/1 and 1 more: cutoff is 5.0, in the baseline 10.0" in answer.out
    Path("gt/1.csv").write_text(rows(0.25), encoding="utf-8")
    batch("moved")
    answer = invoke("gate", "old", "moved")
    assert answer.status == 2
    assert "a/1, b/1: not judged on the same truth: states of the truth changed" in answer.out
    assert "gate: not comparable (exit status 2): 2 pass, 2 not comparable" in answer.out


def test_what_a_bracket_leaves_open_is_undecided(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, invoke: Invoke
) -> None:
    monkeypatch.chdir(tmp_path)
    files = ("--truth", str(SAMPLES / "motchallenge" / "gt.txt"), "-c", "50", "-g", "25", "-q")
    files += ("--estimate", str(SAMPLES / "motchallenge" / "r{name}.txt"), "--workers", "1")
    for folder, solver in (("exact", "certified"), ("open", "sinkhorn")):
        assert (
            invoke("batch", *files, "-o", folder, "--solver", solver, "--epsilon", "1").status == 0
        )
    answer = invoke("gate", "exact", "open")
    assert answer.status == 4
    assert (
        "es: undecided: use a smaller --epsilon than 1, or --solver certified; run batch with this"
        in (" ".join(answer.out.split()))
    )
    assert invoke("batch", *files, "-o", "again", "--solver", "certified").status == 0
    assert invoke("gate", "exact", "again").status == 0
    assert "es: the baseline is not exact, relative gap" in invoke("gate", "open", "exact").out


def test_a_file_made_of_a_store_is_the_baseline_that_gate_makes(
    batch: Invoke, invoke: Invoke
) -> None:
    update = ("--update-baseline", "-q")
    assert invoke("gate", "old", "--baseline", "stored.json", *update).status == 0
    assert invoke("gate", "gt/1.csv", "out/b/1.csv", "--baseline", "one.json", *update).status == 0
    stored, one = (
        json.loads(Path(name).read_text(encoding="utf-8"))["pairs"]
        for name in ("stored.json", "one.json")
    )
    assert sorted(stored) == ["a/1", "a/2", "b/1", "b/2"]
    assert stored["b/1"] == one["pair"] | {"labels": {"run": "1", "tracker": "b"}}
    assert invoke("gate", "old", "--baseline", "stored.json").status == 0
    answer = invoke("gate", "old", "--baseline", "stored.json", "--format", "json", *update)
    assert json.loads(answer.out)["pairs"][0]["notes"] == ["unchanged"]


def test_a_store_is_the_baseline_of_a_suite(batch: Invoke, invoke: Invoke) -> None:
    Path("suite.toml").write_text(
        'baseline = "old"\n[[pair]]\nname = "{tracker}/{run}"\ntruth = "gt/{run}.csv"\n'
        'estimate = "out/{tracker}/{run}.csv"\n',
        encoding="utf-8",
    )
    answer = invoke("gate", "--suite", "suite.toml", "-q")
    assert (answer.status, answer.out.startswith("gate: pass (exit status 0): 4 pass")) == (0, True)
    Path("out/a/1.csv").write_text(rows(3), encoding="utf-8")
    answer = invoke("gate", "--suite", "suite.toml", "-q")
    assert answer.status == 1
    assert "a/1: total is at least 36 (proven); total:+0.001% allows 4.00004" in answer.out
    answer = invoke("gate", "--suite", "suite.toml", "--update-baseline")
    assert (answer.status, "is a batch" in answer.err) == (2, True)


NAMES = ('name = "{run}/{tracker}"', 'name = "{tracker}, run {run}"')


@pytest.mark.parametrize("name", NAMES)
def test_a_pair_and_a_job_are_the_same_if_their_labels_are(
    batch: Invoke, invoke: Invoke, name: str
) -> None:
    suite = (
        f'baseline = "old"\n[[pair]]\n{name}\ntruth = "gt/{{run}}.csv"\n'
        'estimate = "out/{tracker}/{run}.csv"\n[[group]]\nname = "{tracker}"\nseed = "run"\n'
        'fail-on = ["total:+1%"]\n'
    )
    Path("suite.toml").write_text(suite, encoding="utf-8")
    answer = invoke("gate", "--suite", "suite.toml", "--strict")
    assert (answer.status, "not in the baseline" in answer.out + answer.err) == (0, False)
    update = ("--baseline", "b.json", "--update-baseline")
    assert invoke("gate", "--suite", "suite.toml", *update).status == 0
    assert invoke("gate", "old", "--baseline", "b.json").status == 0
    if name == NAMES[0]:
        again = invoke("gate", "old", *update).out
        assert "4 unchanged, 0 removed" in again
        assert invoke("gate", "--suite", "suite.toml", "--baseline", "b.json").status == 0
    pair = suite[suite.index("[[pair]]") : suite.index("[[group]]")]
    other = pair.replace("name = ", 'name = "other/{run}/{tracker}" # ')
    Path("suite.toml").write_text(f'baseline = "old"\n{pair}{other}', encoding="utf-8")
    assert invoke("gate", "--suite", "suite.toml").status == 2


def test_unfinished_jobs_are_named_in_every_output(batch: Invoke, invoke: Invoke) -> None:
    for name in ("half", "rest"):
        batch(name, "--shard", "1/2")
    said = "half: 2 of 4 jobs are done"
    written = ("-o", "g", "--junit", "j.xml", "--github", "--format", "json")
    answer = invoke("gate", "half", "rest", *written)
    assert answer.status == 0
    assert f"::warning title=TGOSPA gate%3A all pairs::{said}" in answer.err
    assert f"warning: {said}" in json.loads(answer.out)["notices"][1]
    assert all(said in Path("g", f"gate.{kind}").read_text("utf-8") for kind in ("html", "md"))
    assert said in Path("j.xml").read_text(encoding="utf-8")
    Path("suite.toml").write_text(
        'baseline = "half"\n[[pair]]\ntruth = "gt/{run}.csv"\n'
        'estimate = "out/{tracker}/{run}.csv"\n[[group]]\nname = "all"\nseed = "run"\n',
        encoding="utf-8",
    )
    assert f"warning: {said}" in invoke("gate", "--suite", "suite.toml").err
    with pytest.warns(TgospaWarning, match=f"^{said}"):
        gate(suite="suite.toml")


WRONG = (
    (("old", "gt/1.csv"), "gt/1.csv: is not the folder of a batch, but old is"),
    (("old", "-c", "3", "--max", "tgospa=1"), "--cutoff: not for stores"),
    (("old", "--proof", "p", "--max", "tgospa=1"), "--proof: not for stores"),
    (("old",), "no baseline: give one with --baseline FILE; --update-baseline makes this file"),
    (("old", "new", "--baseline", "b.json"), "two baselines are given"),
    (("old", "./old"), "./old: is given twice"),
    (("old", "--baseline", "old"), "old: is given twice"),
    (("old", "--baseline", "old", "--update-baseline"), "is a batch, made by tgospa-eval batch"),
    (("old", "--update-baseline"), "no baseline: give the file to write"),
    (("old", "--suite", "s.toml"), "give a store or --suite, not both"),
)


def test_wrong_usage_of_stores(batch: Invoke, invoke: Invoke) -> None:
    for arguments, message in WRONG:
        answer = invoke("gate", *arguments)
        assert (answer.status, message in answer.err) == (2, True), arguments
    settings = json.loads(Path("old/batch.json").read_text(encoding="utf-8"))
    settings["options"]["machine"] = "of a scaling study"
    Path("old/batch.json").write_text(json.dumps(settings), encoding="utf-8")
    shutil.copytree("old", "same")
    answer = invoke("gate", "old", "same")
    assert (answer.status, "gate takes stores that this version of batch made" in answer.err) == (
        3,
        True,
    )
