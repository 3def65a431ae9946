"""The command line as users and scripts meet it: a process with arguments, streams and a status."""

import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from answer import Run, Write
from browser import PATIENCE
from checkout import DOCS

from tgospa_eval import __version__
from tgospa_eval.api import options
from tgospa_eval.cli.shared import click_builder, command
from tgospa_eval.cli.verbs import VERBS, load

Pair = tuple[str, str]

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="signals and pipes of POSIX")
COMMON = "53 of 56 steps are in both files"


def without_timings(text: str) -> str:
    """The bytes of a JSON result but for the timings, which must be there."""
    rest, found = re.subn(r'^ "timings": \{\n.*?^ \},?\n', "", text, flags=re.MULTILINE | re.DOTALL)
    assert found == 1
    return rest


# --- status, streams ------------------------------------------------------------------------------


def test_done(run: Run, quickstart: Pair) -> None:
    status, out, err = run(*quickstart)
    assert status == 0
    assert out.startswith("TGOSPA = 41.788, exact: ")
    assert COMMON in err
    assert "default" not in out  # notices are not data
    assert "TGOSPA" not in err


@pytest.mark.parametrize(
    ("arguments", "status", "part"),
    [
        (["--foo", "t.csv", "e.csv"], 2, "--foo"),
        (["t.csv"], 2, "ESTIMATE"),
        (["t.csv", "e.csv", "e.csv"], 2, "e.csv"),
        (["-c", "-5", "t.csv", "e.csv"], 2, "cutoff is -5: must be finite and > 0"),
        (["none.csv", "e.csv"], 3, "none.csv: no such file"),
        (["t.csv", "."], 3, ".: is a folder"),
        (["t.csv", "bad.csv"], 3, 'bad.csv, line 2, column "x": not a number: "1.2.3"'),
    ],
)
def test_failures(invoke: Run, write: Write, arguments: list[str], status: int, part: str) -> None:
    write("t.csv", "id,t,x\na,1,2\n")
    write("e.csv", "id,t,x\na,1,2\n")
    write("bad.csv", "id,t,x\na,1,1.2.3\n")
    answer = invoke(*arguments)
    assert answer.status == status
    assert answer.out == ""
    assert part in answer.err


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["-c", "0"], ["cutoff", "0", "> 0"]),
        (["-c", "nan"], ["cutoff", "nan", "finite"]),
        (["-c", "inf"], ["cutoff", "inf", "finite"]),
        (["-c", "ten"], ["--cutoff", "ten"]),
        (["-c", "1e200"], ["cutoff", "1e+200", "range"]),
        (["-p", "0.5"], ["order", "0.5", ">= 1"]),
        (["-p", "nan"], ["order", "nan", "finite"]),
        (["-p", "inf"], ["order", "inf", "finite"]),
        (["-g", "-1"], ["switch", "penalty", "-1", ">= 0"]),
        (["-g", "nan"], ["switch", "penalty", "nan"]),
        (["-g", "inf"], ["switch", "penalty", "inf", "finite"]),
        (["-c", "1_0"], ["--cutoff", "'1_0' is no plain, finite number", "2.5"]),
        (["-c", "\uff15"], ["--cutoff", "no plain, finite number"]),
        (["-g", "\u0661"], ["--switch-penalty", "no plain, finite number"]),
        (["-c", "0x10"], ["--cutoff", "no plain, finite number"]),
        (["-c", "1e999"], ["--cutoff", "no plain, finite number"]),
        (["--max-input", "1_0"], ["--max-input", "no plain, finite number"]),
        (["--jobs", "1_0"], ["--jobs", "'1_0' is no whole number; write it as 10"]),
        (["--jobs", "\uff12"], ["--jobs", "no whole number"]),
        (["--jobs", "9" * 5000], ["--jobs", "no whole number"]),
        (["--window", "1_0"], ['window is "1_0"', "must be a number, or one with a unit"]),
        (["--window", "9" * 5000], ['window is "999', "must be finite"]),
        (["--sweep", "c=1_0,2"], ['"1_0" is not a number']),
        (["--sweep", "gamma=1:2:\uff13"], ["COUNT must be a whole number"]),
        (["--periodic", "x=1_0"], ['--periodic "x=1_0"', "a number > 0"]),
        (["--solver", "magic"], ["magic", "certified", "exact", "sinkhorn"]),
        (["--distance", "hamming"], ["hamming", "euclidean", "manhattan", "chebyshev"]),
        (["--format", "xml"], ["xml", "table", "json", "csv", "markdown", "latex"]),
        (["--decimal", ";"], ["--decimal", ";"]),
        (["--on-duplicate", "both"], ["both", "first", "last"]),
        (["--columns", "x,x"], ["columns", '"x"', "twice"]),
        (["--gap", "-1"], ["gap", "-1"]),
        (["--gap", "nan"], ["gap", "nan"]),
        (["--gap", "inf", "--format", "json"], ["gap", "inf"]),
        (["--time-limit", "0"], ["time limit", "0"]),
        (["--time-limit", "-1", "--solver", "exact"], ["time limit", "-1"]),
        (["--time-limit", "nan", "--solver", "sinkhorn"], ["time-limit", "nan"]),
        (["--time-limit", "inf", "--format", "json"], ["time-limit", "inf"]),
        (["--epsilon", "0", "--solver", "sinkhorn"], ["epsilon", "0"]),
        (["--epsilon", "inf", "--solver", "sinkhorn"], ["epsilon", "inf"]),
    ],
    ids=lambda value: " ".join(value) if value and value[0].startswith("-") else "",
)
def test_bad_values(invoke: Run, quickstart: Pair, arguments: list[str], parts: list[str]) -> None:
    status, out, err = invoke(*quickstart, *arguments)
    assert status == 2
    assert out == ""
    for part in parts:
        assert part in err


@pytest.mark.parametrize(
    ("arguments", "format_"),
    [
        (["-g", "1e200"], "json"),  # gamma^p is no double
        (["-c", "1", "-p", "1e300"], "json"),
        (["-c", "1e149"], "table"),
        (["-g", "1e-200"], "table"),
        *((["-c", "1e-149"], name) for name in click_builder.REPORT_FORMATS),
    ],
)
def test_extreme_values(invoke: Run, quickstart: Pair, arguments: list[str], format_: str) -> None:
    status, out, _ = invoke(*quickstart, *arguments, "--format", format_)
    assert status in (0, 2)
    assert not re.search(r"\b(nan|inf)\b", out, re.IGNORECASE)


def test_huge_coordinates_are_far_away(invoke: Run, write: Write) -> None:
    truth = write("t.csv", "id,t,x,y\na,1,1e308,0\na,2,1,0\n")
    estimate = write("e.csv", "id,t,x,y\nb,1,-1e308,0\nb,2,1,0\n")
    status, out, err = invoke(truth, estimate, "--format", "json")
    assert status == 0
    assert json.loads(out)["total"] == 100
    assert "inf" not in err


# --- verbs and files ------------------------------------------------------------------------------


def test_the_verb_may_stand_anywhere_or_nowhere(invoke: Run, quickstart: Pair) -> None:
    truth, estimate = quickstart
    lines = [
        ["-c", "5", truth, estimate],
        [truth, estimate, "-c", "5"],
        [truth, "--cutoff", "5", estimate],
        ["evaluate", truth, estimate, "-c", "5"],
        ["-c", "5", "evaluate", truth, estimate],
        ["-q", "--cutoff=5", "evaluate", truth, estimate],
        ["-qc", "5", truth, estimate],
        ["-c5", "--", truth, estimate],
    ]
    totals = set()
    for line in lines:
        status, out, _ = invoke("--format", "json", *line)
        assert status == 0
        document = json.loads(out)
        assert document["parameters"]["cutoff"] == 5
        totals.add(document["total"])
    assert len(totals) == 1


def test_file_named_like_a_verb(invoke: Run, write: Write) -> None:
    write("evaluate", "id,t,x\na,1,2\n")
    assert invoke("./evaluate", "./evaluate").out.startswith("TGOSPA = 0,")
    assert invoke("evaluate", "evaluate", "evaluate").out.startswith("TGOSPA = 0,")
    assert invoke("--", "evaluate", "evaluate").out.startswith("TGOSPA = 0,")


def test_names_with_spaces_and_other_letters(run: Run, write: Write) -> None:
    write("mein Füße.csv", "id,t,x\na,1,2\n")
    assert run("mein Füße.csv", "mein Füße.csv").status == 0
    assert "kein Füße.csv: no such file" in run("kein Füße.csv", "mein Füße.csv").err


def test_column_of_one_file_only(invoke: Run, write: Write) -> None:
    truth = write("t.csv", "id,t,x,y\na,1,2,3\n")
    estimate = write("e.csv", "id,t,x,y,z\na,1,2,3,4\n")
    for pair in ((truth, estimate), (estimate, truth)):
        status, out, err = invoke(*pair)
        assert (status, out) == (3, "")
        for part in (truth, estimate, '"z"', "--columns x,y"):
            assert part in err
    assert invoke(truth, estimate, "--columns", "x,y").status == 0


@pytest.mark.parametrize(
    ("first", "second", "part"),
    [
        ("2024-01-01T00:00:00Z", "2024-01-01T00:00:00", "--estimate-time-zone UTC"),
        ("2024-01-01T00:00:00", "1704067200", "--truth-time-zone UTC"),
        ("2024-01-01T00:00:00", "5", "both as numbers, such as Unix seconds\n"),
        (str(2**53 + 1), "0.5", "nanoseconds (seconds * 10^9)"),
    ],
)
def test_files_with_other_kinds_of_time(
    invoke: Run, write: Write, first: str, second: str, part: str
) -> None:
    truth = write("t.csv", f"id,t,x\na,{first},2\n")
    estimate = write("e.csv", f"id,t,x\na,{second},2\n")
    status, out, err = invoke(truth, estimate)
    assert (status, out) == (3, "")
    assert part in err
    assert "in both files" not in err  # cannot be counted
    assert truth in err
    assert estimate in err


def test_all_headers_that_are_missing_get_a_proposal(invoke: Run, write: Write) -> None:
    file = write("t.csv", "id,t,x,y\na,1,2,3\n")
    wrong = invoke(file, file, "--columns", "x=px,y=py")
    assert "did you mean --truth-columns x=x,y=y?" in wrong.err
    assert invoke(file, file, "--truth-columns", "x=x,y=y").status == 0


# --- notices --------------------------------------------------------------------------------------


def test_default_values_are_told_with_the_scale_of_the_data(invoke: Run, quickstart: Pair) -> None:
    (line,) = (x for x in invoke(*quickstart).err.splitlines() if "default" in x)
    for part in (
        "cutoff c = 10",
        "gamma = 2",
        "the nearest estimate is 1.11",
        "-c",
        "-g",
    ):
        assert part in line
    (line,) = (x for x in invoke(*quickstart, "-c", "10").err.splitlines() if "default" in x)
    assert "cutoff" not in line
    assert "gamma = 2" in line
    given = invoke(*quickstart, "-c", "10", "-g", "2").err
    assert COMMON in given
    assert "default" not in given


def test_quiet_and_verbose(invoke: Run, quickstart: Pair) -> None:
    loud, quiet = invoke(*quickstart), invoke(*quickstart, "-q")
    assert quiet.err == ""
    assert quiet.out.splitlines()[:-1] == loud.out.splitlines()[:-1]  # the last line is the time
    verbose = invoke(*quickstart, "-v").err
    for stage in ("read", "distances", "solve/preparation", "certify"):
        assert re.search(rf"^{stage} +\d+\.\d+ s$", verbose, re.MULTILINE)


def test_notices_name_the_file(invoke: Run, write: Write) -> None:
    truth = write("t.csv", "id,t,x,note\na,1,2,hi\na,2,,hi\na,3,2,hi\n")
    estimate = write("e.csv", "id,t,x\na,1,2\n")
    err = invoke(truth, estimate).err
    assert f"{truth}: columns not used: note\n" in err
    assert f"{truth}: 1 row with a blank or NaN" in err
    assert f"{estimate}: " not in err
    assert "1 of 3 steps are in both files" in err
    assert re.search(r"^warning: .*33 %", err, re.MULTILINE)


# --- stdout ---------------------------------------------------------------------------------------


def test_version_and_help(invoke: Run) -> None:
    assert invoke("--version")[:2] == (0, f"tgospa-eval {__version__}\n")
    for arguments in (["--help"], ["-h"], ["t.csv", "e.csv", "-h"]):
        status, out, err = invoke(*arguments)
        assert (status, err) == (0, "")
        assert "Usage: tgospa-eval" in out
    assert "--switch-penalty" in out


@pytest.mark.parametrize("verb", VERBS)
def test_help_of_a_verb(invoke: Run, verb: str) -> None:
    status, out, err = invoke(verb, "--help")
    assert (status, err) == (0, "")
    assert max(map(len, out.splitlines())) <= 80
    examples = re.findall(r"^    tgospa-eval .+", out, re.MULTILINE)
    assert examples
    page = (DOCS / "reference" / "options.md").read_text(encoding="utf-8")
    blocks = rf"(?s)<!-- (?:question [^\n]*|options {verb}) -->(.*?)<!-- end -->"
    documented = "".join(re.findall(blocks, page))
    known = set(re.findall(r"^  (?:-\w, )?(--[\w-]+)", out, re.MULTILINE))
    assert len(known) > (1 if verb == "verify" else 10)
    assert not {name for name in known if name not in documented}
    assert set(re.findall(r" (--[\w-]+)", "".join(examples))) <= known  # none is made up
    for arguments in (["help", verb], [verb, "help"]):
        assert invoke(*arguments).out == out


def test_help_is_in_sections(invoke: Run) -> None:
    out = invoke("evaluate", "--help").out
    heads = re.findall(
        r"^(\w+)(?:, with --distance [\w-]+(?: or a sliced one)?)?:$", out, re.MULTILINE
    )
    assert heads == [
        "Metric", "Files", "Filters", "Output", "Solver", "Gaussians", "Particles", "General",
    ]  # fmt: skip
    assert invoke("help").out == invoke("--help").out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["evalute", "t.csv", "e.csv"], "evalute: not a verb or a file; did you mean"),
        (["-c", "5", "rank", "t.csv"], "rank: not a verb or a file; did you mean compare?"),
        (["help", "simulat"], "did you mean simulate?"),
        (["t.csv", "e.csv", "--cutof", "5"], "no such option: --cutof; did you mean --cutoff?"),
        (["gate", "--basel=b.json"], "no such option: --basel; did you mean --baseline?"),
        (["simulate", "x", "--target", "3"], "did you mean --targets?"),
        (["t.csv", "e.csv", "--xyz"], "no such option: --xyz\n"),
        (["simulate", "--save", "x"], "no such option: --save\n"),
        (["simulate", "x", "--plot"], "--plot is not an option of simulate, but of inspect\n"),
        (["t.csv", "e.csv", "--fromat", "json"], "did you mean --format?"),
        (["t.csv", "e.csv", "--json"], "did you mean --format json?"),
        (["t.csv", "e.csv", "--html"], "did you mean -o DIR?"),
        (["t.csv", "e.csv", "--max-dist=5"], "did you mean --cutoff C?"),
        (["gate", "t.csv", "e.csv", "--latex"], "no such option: --latex\n"),
        (["t.csv", "e.csv", "--baseline", "b"], "--baseline is not an option of evaluate, but"),
        (["t.csv", "e.csv", "-gamma", "5"], "have two dashes; type --gamma"),
        (["t.csv", "e.csv", "-output=x"], "have two dashes; type --output"),
        (["t.csv"], "ESTIMATE is missing; type tgospa-eval evaluate t.csv ESTIMATE; for one file"),
        (["reduce", "a b.csv"], "OUT is missing; type tgospa-eval reduce 'a b.csv' OUT"),
        (["t.csv", "a.csv", "b.csv"], "to rank estimates: tgospa-eval compare t.csv a.csv b.csv"),
        (["compare", "t.csv"], "tgospa-eval compare TRUTH A B to rank estimates"),
    ],
)
def test_what_to_type_instead(invoke: Run, arguments: list[str], message: str) -> None:
    answer = invoke(*arguments)
    assert (answer.status, answer.out) == (2, "")
    assert message in answer.err


def test_a_file_may_be_called_like_another_verb(invoke: Run, write: Write) -> None:
    assert invoke(write("rank", "id,t,x\na,1,2\n"), "rank", "-q").status == 0
    assert "truth: no such file" in invoke("truth", "rank").err


@pytest.mark.parametrize("arguments", [["--help"], ["evaluate", "--help"], ["--version"]])
def test_help_imports_nothing_heavy(environment: dict[str, str], arguments: list[str]) -> None:
    code = (
        "import sys\nfrom tgospa_eval.cli import main\n"
        f"try:\n    main({arguments})\nfinally:\n"
        "    print(*sorted(sys.modules), file=sys.stderr)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True
    )
    modules = set(done.stderr.split())
    assert "click" in modules
    assert not modules & {"numpy", "pandas", "scipy", "cvxpy", "clarabel", "highspy", "matplotlib"}


RARE = (
    # Of covariances, particles, other distances, other verbs.
    *("distances.boxes", "distances.clouds", "distances.gaussian", "distances.mahalanobis"),
    *("distances.sphere", "tracks.clouds", "tracks.covariances"),
    *("inspection", "sensors", "campaign", "partitioned"),
    *("formats.spread", "formats.particles", "formats.text.small", "formats.frames"),
    "formats.arrow",
    # Of what writes folders, or other formats than the table.
    *("show.files", "show.html", "cli.shared.writing", "show.figure_tools"),
)


def test_a_small_evaluation_imports_little(
    unmeasured: dict[str, str], quickstart: Pair, tmp_path: Path
) -> None:
    code = (
        "import sys\nfrom tgospa_eval.cli import main\n"
        f"try:\n    main({list(quickstart)})\nfinally:\n"
        "    print(*sorted(sys.modules), file=sys.stderr)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True, text=True, env=unmeasured, check=True, cwd=tmp_path,
    )  # fmt: skip
    modules = set(done.stderr.splitlines()[-1].split())
    assert "numpy" in modules
    assert not modules & {"pandas", "cvxpy", "clarabel", "numpy.ma", "tomllib", "html"}
    assert not modules & {"json", "fractions", "decimal", "glob", "shlex", "logging"}
    ours = {name.removeprefix("tgospa_eval.") for name in modules}
    assert {"distances.vector", "show.result_text"} <= ours
    assert all(find_spec(f"tgospa_eval.{name}") for name in RARE)
    assert not ours & {*RARE}


def test_option_choices_are_the_members() -> None:
    # Spelled out in the options, because importing the members would make --help slow.
    from tgospa_eval.campaign.pairs import LAYOUTS
    from tgospa_eval.show.result_text import REPORTS
    from tgospa_eval.solvers import SOLVERS

    assert tuple(LAYOUTS) == options.LAYOUTS
    assert tuple(SOLVERS) == options.SOLVERS
    assert tuple(REPORTS) == (*click_builder.REPORT_FORMATS, "methods")


@pytest.mark.parametrize("solver", ["certified", "sinkhorn"])  # the referee is slow to start
def test_json_is_the_same_bytes_every_time(run: Run, quickstart: Pair, solver: str) -> None:
    first, second = (
        run(*quickstart, "--format", "json", "--solver", solver, env={"PYTHONHASHSEED": seed})
        for seed in ("1", "2")
    )
    assert first.status == 0
    assert without_timings(first.out) == without_timings(second.out)

    def is_sorted(value: Any) -> bool:
        if isinstance(value, dict):
            return list(value) == sorted(value) and all(map(is_sorted, value.values()))
        return all(map(is_sorted, value)) if isinstance(value, list) else True

    assert is_sorted(json.loads(first.out))


@POSIX
@pytest.mark.parametrize("format_", ["table", "json"])
def test_closed_reader_is_no_failure(
    environment: dict[str, str], quickstart: Pair, format_: str
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "tgospa_eval", *quickstart, "--format", format_],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        env=environment,
    )
    assert process.stdout is not None
    process.stdout.close()  # as head does when it has enough
    assert process.stderr is not None
    err = process.stderr.read()
    process.stderr.close()
    assert process.wait(PATIENCE) == 0  # 1 would say: a regression is proven
    assert "Traceback" not in err
    assert "Broken" not in err


LOST = pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        ("--version",),
        ("gate", "--help"),
        ("{}", "{}", "-q"),
        ("inspect", "{}"),
    ],
    ids=lambda arguments: arguments[0],
)


@POSIX
@LOST
@pytest.mark.parametrize(
    ("stdout", "message"),
    [("&-", b"stdout is closed"), ("/dev/full", b"stdout cannot be written: No space left")],
    ids=["closed", "full"],
)
def test_a_lost_output_is_a_failure(
    environment: dict[str, str],
    quickstart: Pair,
    tmp_path: Path,
    arguments: tuple[str, ...],
    stdout: str,
    message: bytes,
) -> None:
    if stdout.startswith("/") and not Path(stdout).exists():
        pytest.skip("has no full device")
    typed = [text.format(quickstart[0]) for text in arguments]
    done = subprocess.run(
        ["sh", "-c", f'"$@" >{stdout}', "sh", sys.executable, "-m", "tgospa_eval", *typed],
        cwd=tmp_path, env=environment, capture_output=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, b"")
    assert message in done.stderr
    assert b"Traceback" not in done.stderr


@POSIX
def test_a_closed_stderr_changes_nothing(environment: dict[str, str], quickstart: Pair) -> None:
    done = subprocess.run(
        ["sh", "-c", '"$@" 2>&-', "sh", sys.executable, "-m", "tgospa_eval", *quickstart],
        env=environment, stdout=subprocess.PIPE, check=False,
    )  # fmt: skip
    assert done.returncode == 0
    assert b"TGOSPA" in done.stdout


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
def test_ids_that_stdout_cannot_encode(run: Run, write: Write, encoding: str) -> None:
    truth = write("t.csv", "id,t,x\nFüße-車,1,2\n")
    estimate = write("e.csv", "id,t,x\n")
    # Decoding is strict: bytes of another encoding fail here.
    answer = run(
        truth, estimate, "--unit", "車", env={"PYTHONIOENCODING": encoding}, encoding=encoding
    )
    assert answer.status == 0
    (line,) = (x for x in answer.out.splitlines() if "worst objects" in x)
    assert re.fullmatch(r"\s+worst objects\s+F\S+e-\S+", line)
    assert ("Füße" in line) == (encoding == "cp1252")


def test_ids_that_stdout_can_encode(run: Run, write: Write) -> None:
    truth = write("t.csv", "id,t,x\nFüße-車,1,2\n")
    assert "Füße-車" in run(truth, write("e.csv", "id,t,x\n")).out


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("a", []),
        ("long-" * 60, []),
        ("a", ["--unit", "metres"]),
        ("a", ["--unit", "metres", "-c", "1.23456789e-05", "-g", "1.23456789e-05"]),
    ],
    ids=["short ids", "long ids", "unit", "unit and long numbers"],
)
def test_the_table_fits_80_columns(
    invoke: Run, write: Write, name: str, arguments: list[str]
) -> None:
    # Two truths, two estimates that swap, a miss and a false track: every line of the table.
    rows = [(k, f"2024-01-01T00:00:00.00000000{t}Z", 1000.5 * t) for t in range(5) for k in (0, 1)]
    truth = "".join(f'"{name}{k}",{t},{x + 7 * k}\n' for k, t, x in rows)
    estimate = "".join(
        f'"{name}{k}",{t},{x + (7 * k if n < 5 else 7 - 7 * k) + 1}\n'
        for n, (k, t, x) in enumerate(rows)
    )
    paths = write("t.csv", "id,t,x\n" + truth), write("e.csv", "id,t,x\n" + estimate)
    status, out, _ = invoke(*paths, *arguments)
    assert status == 0
    assert "TGOSPA" in out
    assert max(map(len, out.splitlines())) <= 80


def test_the_headline_of_a_bracket_fits_80_columns(invoke: Run, crowd: Pair) -> None:
    _, out, _ = invoke(*crowd, "--unit", "metres", "--time-limit", "1e-6")
    assert out.startswith("TGOSPA is between ")
    assert len(out.splitlines()[0]) <= 80


def test_an_id_takes_one_line_of_the_table(invoke: Run, write: Write) -> None:
    truth = write("t.csv", 'id,t,x\n"two\nlines",1,2\n')
    _, out, _ = invoke(truth, write("e.csv", "id,t,x\n"))
    (line,) = (x for x in out.splitlines() if "worst objects" in x)
    assert "two" in line
    assert "lines" in line


# --- limits ---------------------------------------------------------------------------------------


def test_small_gaps_are_allowed_and_may_not_be_met(invoke: Run, quickstart: Pair) -> None:
    status, _, err = invoke(*quickstart, "-c", "10", "-g", "5", "--gap", "1e-17")
    assert status == 4
    assert (
        "requested: 1e-17; bounds are rounded outward, so a gap below 1e-12 may be impossible"
        in err
    )


@pytest.mark.parametrize("solver", ["certified", "sinkhorn", "exact"])
def test_a_stopped_run_leaves_a_bracket(invoke: Run, crowd: Pair, solver: str) -> None:
    limits = ["--solver", solver, "--time-limit", "1e-6", "--format", "json"]
    status, out, err = invoke(*crowd, *limits)
    document = json.loads(out)
    assert status == 4
    assert "accuracy not reached" in err
    assert document["certified"] is False
    # The certified solver proves the optimum when it has time.
    _, exact, _ = invoke(*crowd, "--format", "json")
    optimum = json.loads(exact)
    assert optimum["certified"] is True
    assert document["lower_bound"] <= optimum["upper_bound"]
    assert document["upper_bound"] >= optimum["lower_bound"]
    assert document["relative_gap"] > 1e-9
    assert document["tgospa"] == pytest.approx(document["upper_bound"], rel=1e-12)


def test_a_limit_that_is_not_reached_changes_nothing(invoke: Run, quickstart: Pair) -> None:
    status, out, _ = invoke(*quickstart, "--time-limit", "3600", "--format", "json")
    assert status == 0
    assert json.loads(out)["certified"] is True


def test_a_bracket_of_sinkhorn_is_an_answer(invoke: Run, crowd: Pair) -> None:
    status, out, _ = invoke(*crowd, "--solver", "sinkhorn", "--epsilon", "0.5")
    assert status == 0
    assert out.startswith("TGOSPA is between ")


# --- the result folder ----------------------------------------------------------------------------

FILES = [
    ".tgospa-eval.json",
    "assignments.csv",
    "per_estimate.csv",
    "per_step.csv",
    "per_truth.csv",
    "report.html",
    "result.json",
    "switches.csv",
    "timings.csv",
]


def test_result_folder(invoke: Run, quickstart: Pair, tmp_path: Path) -> None:
    status, out, _ = invoke(*quickstart, "-o", "new/out", "--format", "json")
    assert status == 0
    assert sorted(os.listdir(tmp_path)) == ["new"]
    assert os.listdir(tmp_path / "new") == ["out"]  # nothing left beside
    assert sorted(os.listdir(tmp_path / "new" / "out")) == FILES
    assert (tmp_path / "new" / "out" / "result.json").read_bytes() == out.encode()


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_result_folder_of_others(invoke: Run, quickstart: Pair, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    for name in ("per_step.csv", "plane.png", "notes.txt"):
        (folder / name).write_text("mine", encoding="utf-8")
    before = contents(folder)
    status, out, err = invoke(*quickstart, "-c", "5", "-o", "out")
    assert (status, out) == (2, "")
    assert "out: is not empty" in err
    assert "--force" in err
    assert contents(folder) == before
    assert os.listdir(tmp_path) == ["out"]
    assert invoke(*quickstart, "-c", "5", "-o", "out", "--force").status == 0
    assert sorted(os.listdir(folder)) == sorted([*FILES, "notes.txt", "plane.png"])
    assert (folder / "per_step.csv").read_bytes() != b"mine"
    assert (folder / "plane.png").read_bytes() == b"mine"


def test_a_result_is_written_anew(invoke: Run, quickstart: Pair, tmp_path: Path) -> None:
    """Without --force, without files of the run before, and with all that others have put there."""
    folder = tmp_path / "out"
    folder.mkdir()
    first = invoke(*quickstart, "-o", "out", "--curve").err
    assert f"wrote 9 files to {os.path.join('out', '')}; open {OPEN}" in first
    assert "curve.csv" in os.listdir(folder)
    for name in ("lanes.png", "notes.txt"):
        (folder / name).write_text("mine", encoding="utf-8")
    status, _, err = invoke(*quickstart, "-c", "5", "-o", "out")
    assert status == 0
    assert "wrote 8 files to" in err
    assert f", removed 1 of an earlier run; open {OPEN}" in err
    assert sorted(os.listdir(folder)) == sorted([*FILES, "lanes.png", "notes.txt"])
    assert json.loads((folder / "result.json").read_bytes())["parameters"]["cutoff"] == 5
    assert "wrote" not in invoke(*quickstart, "-c", "5", "-o", "out", "-q").err


OPEN = os.path.join("out", "report.html")


def test_only_files_of_a_run_are_replaced_or_removed(
    invoke: Run, quickstart: Pair, tmp_path: Path
) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    mine = dict.fromkeys(("notes.txt", "curve.csv", "costs.svg", "result.json"), b"mine")
    for name, data in mine.items():
        (folder / name).write_bytes(data)
    evaluate = (*quickstart, "-q", "-o", "out")
    assert invoke(*evaluate, "--force").status == 0  # which replaces result.json alone
    del mine["result.json"]
    assert invoke(*evaluate).status == 0
    assert mine.items() <= contents(folder).items()
    status, out, err = invoke(*evaluate, "--curve")
    assert (status, out) == (2, "")  # before any work
    assert "out: curve.csv in it was not written by an earlier run" in err
    (folder / "report.html").write_bytes(b"changed")
    assert "report.html in it" in invoke(*evaluate).err
    assert (folder / "report.html").read_bytes() == b"changed"
    manifest = json.loads((folder / ".tgospa-eval.json").read_bytes())
    assert sorted(file["name"] for file in manifest["files"]) == FILES[1:]


@pytest.mark.parametrize("wrap", ["{}", '{{"mine": {}}}'])
def test_a_result_that_the_user_has_saved_is_no_folder_of_ours(
    invoke: Run, quickstart: Pair, tmp_path: Path, wrap: str
) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    document = invoke(*quickstart, "-q", "--format", "json").out
    (folder / "result.json").write_text(wrap.format(document), encoding="utf-8")
    (folder / "report.html").write_text("mine", encoding="utf-8")
    before = contents(folder)
    answer = invoke(*quickstart, "-o", "out")
    assert (answer.status, answer.out) == (2, "")
    assert "out: is not empty" in answer.err
    assert contents(folder) == before


def test_what_others_are_at_is_not_cleared_away(
    invoke: Run, quickstart: Pair, tmp_path: Path
) -> None:
    folder = tmp_path / "out"
    left = [folder / f".tgospa-eval-new-{name}" for name in (f"{os.getpid()}-a", "99999999-b")]
    for path in left:
        path.mkdir(parents=True)
    assert invoke(*quickstart, "-o", "out").status == 0
    assert [path.exists() for path in left] == [True, False]
    os.utime(left[0], (0, 0))
    assert invoke(*quickstart, "-o", "out").status == 0
    assert sorted(os.listdir(folder)) == FILES


def test_a_result_that_was_cut_off_is_written_anew(
    invoke: Run, quickstart: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The old document is gone before any file changes: it never stands beside new tables."""
    folder = tmp_path / "out"
    assert invoke(*quickstart, "-o", "out").status == 0
    replace = os.replace

    def cut_off(source: Path, target: Path) -> None:
        if Path(target).name == "switches.csv":
            raise OSError(5, "the power is gone")
        replace(source, target)

    with monkeypatch.context() as broken:
        broken.setattr(os, "replace", cut_off)
        status, out, err = invoke(*quickstart, "-c", "5", "-o", "out")
    assert status == 2
    assert out.startswith("TGOSPA = 25.6659")  # what was computed is not lost
    assert "out: cannot be written: the power is gone" in err
    assert "result.json" not in os.listdir(folder)
    assert invoke(*quickstart, "-c", "5", "-o", "out").status == 0
    assert sorted(os.listdir(folder)) == FILES


def test_two_runs_write_one_folder(
    invoke: Run, quickstart: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another run makes the folder just before this one does: the last one has all of it."""
    folder, other = tmp_path / "out", tmp_path / "other"
    assert invoke(*quickstart, "--curve", "-o", "other").status == 0
    replace = os.replace

    def too_late(source: Path, target: Path) -> None:
        if other.exists():
            os.rename(other, folder)
        replace(source, target)

    with monkeypatch.context() as raced:
        raced.setattr(os, "replace", too_late)
        assert invoke(*quickstart, "-c", "5", "-o", "out").status == 0
    assert sorted(os.listdir(tmp_path)) == ["out"]
    assert sorted(os.listdir(folder)) == FILES
    assert json.loads((folder / "result.json").read_bytes())["parameters"]["cutoff"] == 5


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("x.html", "name it x"),
        ("x.json", "type --format json > x.json"),
        ("x.CSV", "type --format csv > x.CSV"),
        ("x.md", "type --format markdown > x.md"),
        ("x.tex", "type --format latex > x.tex"),
        ("x.pdf", "name it x"),
    ],
)
def test_result_folder_that_is_called_like_a_file(
    invoke: Run, quickstart: Pair, tmp_path: Path, name: str, remedy: str
) -> None:
    status, out, err = invoke(*quickstart, "-o", name)
    assert (status, out) == (2, "")
    assert err == f"--output {name}: must be a folder, not a file; {remedy}\n"
    (tmp_path / name).mkdir()
    assert invoke(*quickstart, "-o", name).status == 0


@pytest.mark.parametrize("folder", ["file", "file/out"])
def test_result_folder_that_cannot_be(
    invoke: Run, quickstart: Pair, tmp_path: Path, folder: str
) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    status, out, err = invoke(*quickstart, "-o", folder)
    assert (status, out) == (2, "")
    assert folder in err
    assert (tmp_path / "file").read_text(encoding="utf-8") == "mine"


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere"
)
def test_result_folder_where_writing_is_forbidden(
    invoke: Run, quickstart: Pair, tmp_path: Path
) -> None:
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    status, _, err = invoke(*quickstart, "-o", "locked/out")
    assert status == 2
    assert "locked/out: cannot be written" in err
    assert list(locked.iterdir()) == []


def test_a_bad_input_leaves_no_folder(invoke: Run, write: Write, tmp_path: Path) -> None:
    bad = write("bad.csv", "id,t,x\na,1,oops\n")
    assert invoke(bad, bad, "-o", "out").status == 3
    assert os.listdir(tmp_path) == ["bad.csv"]


@pytest.mark.parametrize("verb", VERBS)
def test_the_short_help_is_one_screen_with_usage_example_and_ten_options(
    invoke: Run, verb: str
) -> None:
    done = invoke(verb, "-h")
    lines = done.out.splitlines()
    assert (done.status, done.err) == (0, "")
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80
    assert lines[0].startswith(f"Usage: tgospa-eval {verb}")
    assert sum(line.startswith("  tgospa-eval ") for line in lines) == 1
    shown = re.findall(r"^  (?:-\w, )?(--[\w-]+)", done.out, re.MULTILINE)
    assert len(shown) == (5 if verb == "verify" else 10)
    assert {*shown} <= {*command.long_options(load(verb))}
    section = "general"
    one = invoke("help", verb, section)
    assert one.status == 0
    assert len(one.out) < len(invoke(verb, "--help").out)


def test_a_section_of_the_help_by_its_name(invoke: Run) -> None:
    out = invoke("help", "evaluate", "metric").out
    assert "--cutoff" in out
    assert "--columns" not in out
    assert invoke("evaluate", "--help-all").out == invoke("help", "evaluate").out
    assert "evaluate has no section zzz; there are metric," in invoke("help", "evaluate", "zzz").err
    assert "no verb zzz; there are evaluate, inspect," in invoke("help", "zzz", "metric").err
    assert "--runs" in invoke("help", "compare", "scaling", "study").out
