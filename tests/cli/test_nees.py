"""NEES wherever results go: point distances, data in parts, gates, batches, rankings, pictures."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from answer import Invoke
from partitioned import without_summary

from tgospa_eval import ConfigError, TgospaWarning, Trajectories, compare, evaluate
from tgospa_eval.evaluation import memory
from tgospa_eval.results.consistency import NeesSums, band

METRIC = ("-c", "12", "-g", "5", "-q", "--jobs", "1")
GAUSSIAN = ("--distance", "gaussian-wasserstein")


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def write_sides(name: str, error: float, claimed: float, seed: int = 3, tracks: int = 8) -> None:
    """A truth, and an estimate with other ids from step 30 on, of which 5 % are missed."""
    rng, steps = np.random.default_rng(seed), 60
    track, step = (each.ravel() for each in np.indices((tracks, steps)))
    truth = pd.DataFrame({"id": track, "t": step, "x": 15.0 * track, "y": 0.5 * step})
    estimate = truth.assign(id=[f"e{i}.{t // 30}" for i, t in zip(track, step, strict=True)])
    estimate[["x", "y"]] += rng.normal(0, error, (len(truth), 2))
    size = claimed**2 * rng.uniform(0.8, 1.25, len(truth))
    estimate = estimate.assign(cov_xx=size, cov_xy=0.1 * size, cov_yy=size)
    estimate.loc[::97, ["cov_xx", "cov_xy"]] = 0.0  # singular ones
    estimate = estimate[rng.random(len(truth)) < 0.95]
    truth.to_csv("truth.csv", index=False)
    estimate.to_csv(f"{name}.csv", index=False)


@pytest.mark.parametrize("asked", [GAUSSIAN, ("--with", "nees")])
@pytest.mark.parametrize(("rows", "entries"), [(40, 10**6), (10**6, 60)])
def test_data_in_parts_have_the_numbers_of_files_in_memory(
    invoke: Invoke,
    monkeypatch: pytest.MonkeyPatch,
    asked: tuple[str, ...],
    rows: int,
    entries: int,
) -> None:
    """Sums add up block by block, in the order of time: equal to 1e-12."""
    write_sides("kf", 1.3, 1.0)
    for side in ("truth", "kf"):
        Path(side).mkdir()
        for k, part in pd.read_csv(f"{side}.csv").groupby(lambda row: row % 3):
            part.to_parquet(f"{side}/{k}.parquet")
    monkeypatch.setattr(memory, "MAX_ROWS", rows)
    monkeypatch.setattr(memory, "SHARD_ENTRIES", entries)
    assert invoke("truth.csv", "kf.csv", *METRIC, *asked, "-o", "one").status == 0
    answer = invoke("truth", "kf", *METRIC, *asked, "--memory", "400MB", "-o", "many")
    assert answer.status == 0, answer.err
    one, many = (json.loads(Path(name, "result.json").read_text()) for name in ("one", "many"))
    both = [document["nees"] for document in (one, many)]
    sums = [record.pop("sums") for record in both]
    assert [record.pop("verdict") for record in both] == ["overconfident"] * 2
    assert [record.pop("ranks") for record in sums] == [[], []]
    assert both[1] == pytest.approx(both[0], rel=1e-12)
    assert sums[1] == pytest.approx(sums[0], rel=1e-12)
    assert sums[0]["singular"] > 0
    assert one["per_step"][7].keys() == many["per_step"][7].keys()
    assert [w["code"] for w in one["warnings"]] == [w["code"] for w in many["warnings"]]
    assert ("localisation_spread" in many) is (asked == GAUSSIAN)
    for table in ("per_step", "per_truth", "per_estimate", "assignments"):
        path = f"many/{table}" + ("" if table == "assignments" else ".parquet")
        texts = dict.fromkeys(("id", "truth", "estimate"), str)
        expected, found = pd.read_csv(f"one/{table}.csv", dtype=texts), pd.read_parquet(path)
        assert "nees" in expected
        expected = without_summary(expected)
        pd.testing.assert_frame_equal(found, expected, rtol=1e-12, atol=0, check_dtype=False)


def test_points_are_compared_and_covariances_judged(invoke: Invoke) -> None:
    write_sides("kf", 1.0, 1.0)
    asked = ("truth.csv", "kf.csv", *METRIC, "--format", "json")
    plain, beside, gaussian = (
        json.loads(invoke(*asked, *more).out) for more in ((), ("--with", "nees"), GAUSSIAN)
    )
    assert "nees" not in plain
    assert beside["nees"] == gaussian["nees"]  # of the same assignment
    assert beside["tgospa"] == plain["tgospa"]
    assert beside["parameters"] == plain["parameters"]
    assert beside["input"] == plain["input"]
    assert "with" not in beside
    answer = invoke(*asked[:-2], "--with", "nees", "--on-invalid", "drop", "--fix-cov")
    assert answer.status == 0
    answer = invoke("truth.csv", "truth.csv", *METRIC, "--with", "nees")
    assert answer.status == 3
    assert "truth.csv: --with nees needs covariances" in answer.err
    answer = invoke("truth.csv", "kf.csv", *METRIC, "--by", "class", "--with", "nees,gospa")
    assert "--with cannot be combined with --by class" in answer.err


def test_objects_and_particles_have_a_nees_as_points() -> None:
    from stonesoup.types.groundtruth import GroundTruthPath
    from stonesoup.types.state import GaussianState, State
    from stonesoup.types.track import Track

    rng, start = np.random.default_rng(5), datetime(2024, 1, 1, tzinfo=UTC)
    stamps = [start + timedelta(seconds=k) for k in range(20)]
    truth = GroundTruthPath([State([k, 0.0], timestamp=t) for k, t in enumerate(stamps)])
    errors = rng.normal(size=(20, 2))
    states = [
        GaussianState(np.array([[k], [0.0]]) + e[:, None], 2 * np.eye(2), timestamp=t)
        for k, (e, t) in enumerate(zip(errors, stamps, strict=True))
    ]
    result = evaluate({truth}, {Track(states)}, 10, 2, 5, mapping=[0, 1], with_="nees")
    assert result.nees is not None
    assert result.nees.total == pytest.approx((errors**2).sum() / 2)
    assert evaluate({truth}, {Track(states)}, 10, 2, 5, mapping=[0, 1]).nees is None
    # A file of particles: the same as their cloud with its moments and ranks.
    write_particles()
    asked = ("truth.csv", "cloud.csv")
    points = evaluate(*asked, 12, 2, 5, with_=["nees"])
    clouds = evaluate(*asked, 12, 2, 5, distance="cloud-wasserstein")
    assert points.nees is not None
    assert clouds.nees is not None
    assert points.nees.plain() == clouds.nees.plain()
    assert np.array(points.nees.ranks).sum(axis=1) == pytest.approx([90, 90])


def write_particles() -> None:
    rng = np.random.default_rng(6)
    rows = [(i, t, 30.0 * i, float(t)) for i in range(3) for t in range(30)]
    centres = np.array(rows)[:, 2:] + rng.normal(size=(90, 2)) * [1, 2]
    places = centres[:, None] + rng.normal(size=(90, 50, 2))
    truth = pd.DataFrame(rows, columns=["id", "t", "x", "y"])
    truth.to_csv("truth.csv", index=False)
    cloud = truth.loc[truth.index.repeat(50), ["id", "t"]]
    cloud[["x", "y"]], cloud["weight"] = places.reshape(-1, 2), 0.02
    cloud.to_csv("cloud.csv", index=False)


def test_longitudes_are_compared_the_shorter_way_round() -> None:
    columns = ("lat", "lon")
    truth = Trajectories.from_array(np.array([[[0.0, 179.9999]]]), columns)
    estimate = Trajectories.from_array(
        np.array([[[0.0, -179.9999]]]), columns, covariance=1e-8 * np.eye(2)
    )
    result = evaluate(truth, estimate, 100, 2, 5, distance="haversine", with_="nees")
    assert result.nees is not None
    assert result.nees.mean == pytest.approx(0.0002**2 / 1e-8)


def test_of_a_calibrated_filter_95_percent_are_inside() -> None:
    """Through the whole line, with as many covariances as states."""
    rng = np.random.default_rng(14)
    half = rng.normal(size=(200, 20, 2, 2))
    spread = half @ half.swapaxes(2, 3) + 0.2 * np.eye(2)
    errors = np.linalg.cholesky(spread) @ rng.normal(size=(200, 20, 2, 1))
    truth = np.zeros((200, 20, 2)) + 1000.0 * np.arange(20)[:, None]
    estimate = Trajectories.from_array(truth + errors[..., 0], covariance=spread)
    nees = evaluate(truth, estimate, 100, 2, 50, with_="nees").nees
    assert nees is not None
    assert nees.pairs == 4000
    assert nees.inside / nees.pairs == pytest.approx(0.95, abs=3 * (0.95 * 0.05 / 4000) ** 0.5)
    assert nees.mean == pytest.approx(2, abs=3 * (4 / 4000) ** 0.5)
    assert nees.verdict == "consistent"


# -------------------------------------------------------------------------------------------------
# Gates.


@pytest.mark.parametrize(
    ("rules", "status", "told"),
    [
        (("nees:1.5..2.5",), 0, ""),
        (("nees:..1.5",), 1, "nees<=1.5 allows 1.5"),
        (("nees:2.9..",), 1, "nees>=2.9 allows at least 2.9"),
        (("nees.inside:0.9..", "nees.anees:..1.2"), 0, ""),
        (("nees.inside:0.99..,nees:..9",), 1, "nees.inside>=0.99 allows at least 0.99"),
        (("nees:..",), 2, "must be a range such as nees:1.5..2.5"),
        (("nees:5..3",), 2, "the first limit is larger; swap them"),
        (("nees:b..9",), 2, "must be a range such as nees:1.5..2.5"),
        (("nees.inside:+0.1",), 2, "nees.inside is better when larger; write PATH:-N"),
        (("total:-1",), 2, "total is better when smaller; write PATH:+N"),
    ],
)
def test_gate_rules_of_absolute_ranges(
    invoke: Invoke, rules: tuple[str, ...], status: int, told: str
) -> None:
    write_sides("kf", 1.0, 1.0)
    given = (part for rule in rules for part in ("--fail-on", rule))
    answer = invoke("gate", "truth.csv", "kf.csv", *METRIC[:-2], *given)
    assert answer.status == status, answer.out + answer.err
    assert told in " ".join((answer.out + answer.err).split())


def test_gate_rules_against_a_baseline(invoke: Invoke) -> None:
    write_sides("kf", 1.0, 1.0)
    write_sides("sure", 1.0, 0.4)
    rules = ("--fail-on", "nees:+10%", "--fail-on", "nees.inside:-0.01", "--warn-on", "nees:-10%")
    asked = ("--baseline", "b.json", *rules, "-q")
    answer = invoke("gate", "truth.csv", "kf.csv", *asked, "-c", "12", "-g", "5", *UPDATE)
    assert answer.status == 0, answer.err
    assert "nees.inside" in answer.out
    saved = json.loads(Path("b.json").read_text())
    record = saved["pairs"]["pair"]["values"]["nees"]
    assert record["mean"] == pytest.approx(record["sums"]["total"] / record["sums"]["pairs"])
    assert invoke("gate", "truth.csv", "kf.csv", *asked).status == 0
    answer = invoke("gate", "truth.csv", "sure.csv", *asked, "--junit", "j.xml", "-o", "report")
    assert answer.status == 1
    line = next(line for line in answer.out.splitlines() if "nees:-10%" in line)
    assert line.split()[-1] == "pass"
    cases = {case.get("name"): case for case in ElementTree.parse("j.xml").iter("testcase")}
    assert list(cases) == ["nees", "nees.inside less", "nees less warning"]
    assert "at least" in str(cases["nees.inside less"].find("failure").get("message"))
    assert "`nees.inside:-0.01`" in Path("report/gate.md").read_text()
    record["mean"] *= 2  # edited by hand: contradicts its sums
    Path("b.json").write_text(json.dumps(saved))
    answer = invoke("gate", "truth.csv", "kf.csv", *asked)
    assert answer.status == 2
    assert "pair.values.nees does not follow from its sums" in answer.err
    # A baseline that was made without it, and a result that has none.
    invoke("gate", "truth.csv", "kf.csv", "--baseline", "c.json", "-c", "12", "-g", "5", *UPDATE)
    answer = invoke("gate", "truth.csv", "kf.csv", "--baseline", "c.json", "--fail-on", "nees:+1")
    assert answer.status == 2
    assert "the baseline has no NEES" in answer.out
    asked = ("--baseline", "c.json", "--fail-on", "nees:+1")
    answer = invoke("gate", "truth.csv", "truth.csv", *asked)
    assert answer.status == 3
    assert "--with nees needs covariances" in answer.err


PICTURES = ("-o", "out", "--pictures", "png")
UPDATE = ("--update-baseline", "-q")


def write_runs() -> None:
    """Two runs of a right and an overconfident filter, in a folder each."""
    for run_ in (1, 2):
        for name, error, claimed in (("right", 1.0, 1.0), ("sure", 1.2, 0.3)):
            write_sides(name, error, claimed, seed=run_)
            Path(f"runs/{run_}").mkdir(parents=True, exist_ok=True)
            Path(f"{name}.csv").rename(f"runs/{run_}/{name}.csv")
        Path("truth.csv").rename(f"runs/{run_}/truth.csv")


def test_groups_of_a_suite_add_the_sums_up(invoke: Invoke) -> None:
    write_runs()
    Path("suite.toml").write_text(
        'baseline = "b.json"\n[options]\ncutoff = 12\nswitch-penalty = 5\n'
        '[[pair]]\ntruth = "runs/{seed}/truth.csv"\nestimate = "runs/{seed}/right.csv"\n'
        '[[group]]\nfail-on = ["nees:1.5..2.5", "nees:+5%"]\n'
    )
    assert invoke("gate", "--suite", "suite.toml", *UPDATE).status == 0
    answer = invoke("gate", "--suite", "suite.toml", "--format", "json", "-q")
    assert answer.status == 0, answer.err
    (group,) = json.loads(answer.out)["groups"]
    pairs = json.loads(Path("b.json").read_text())["pairs"].values()
    sums = [NeesSums(**entry["values"]["nees"]["sums"]) for entry in pairs]
    joined = NeesSums.joined(sums)
    assert joined is not None
    assert [rule["upper"] for rule in group["rules"]] == pytest.approx([joined.mean] * 3)
    for run_ in (1, 2):
        Path(f"runs/{run_}/sure.csv").replace(f"runs/{run_}/right.csv")
    answer = invoke("gate", "--suite", "suite.toml", "-q")
    assert answer.status == 1
    assert "nees<=2.5 allows" in answer.out


# -------------------------------------------------------------------------------------------------
# Rankings and batches: who reads the order sees what made it.


@pytest.mark.parametrize("format", ["table", "markdown", "latex"])
def test_who_reads_only_the_order_sees_what_covariances_made(invoke: Invoke, format: str) -> None:
    write_sides("right", 1.0, 1.0)
    write_sides("sure", 1.2, 0.3)
    asked = ("compare", "truth.csv", "right.csv", "sure.csv", *METRIC, *GAUSSIAN)
    lines = invoke(*asked, "--format", format).out
    head, _, tables = " ".join(lines.split()).partition("c = 12")
    assert head.index("best first: sure, right") < head.index("sure: covariances are too small")
    assert "covariances decide this order" in head
    for word in ("means", "spreads", "NEES", "overconfident", "consistent"):
        assert word in tables
    if format == "table":
        assert max(map(len, lines.splitlines())) <= 80


def test_python_is_warned_as_well() -> None:
    write_sides("right", 1.0, 1.0)
    write_sides("sure", 1.2, 0.3)
    files = {name: f"{name}.csv" for name in ("right", "sure")}
    with pytest.warns(TgospaWarning, match="covariances decide this order"):
        found = compare("truth.csv", files, 12, 2, 5, distance="gaussian-wasserstein")
    assert list(found.table()["name"]) == ["sure", "right"]
    assert found.table()["nees_mean"][0] > 10 * found.table()["nees_anees"][1]
    codes = [record["code"] for record in found.to_dict()["warnings"]]
    assert codes == ["overconfident", "order-by-covariances"]
    with pytest.warns(TgospaWarning, match="sure: covariances are too small"):
        found = compare("truth.csv", files, 12, 2, 5, with_=("nees", "gospa"))
    assert list(found.table()["name"]) == ["right", "sure"]
    assert {"nees_mean", "gospa_total"} <= {*found.table()}
    with pytest.raises(ConfigError, match="not for comparing solvers"):
        compare("truth.csv", "sure.csv", 12, 2, 5, solvers=["exact"], with_="nees")


def test_a_batch_says_it_by_tracker(invoke: Invoke) -> None:
    write_runs()
    asked = ("batch", "--truth", "runs/{run}/truth.csv", "--estimate", "runs/{run}/{tracker}.csv")
    asked = (*asked, "--by", "tracker", *METRIC[:-2], *GAUSSIAN, "-o", "out")
    text = " ".join(invoke(*asked).out.split())
    assert text.index("best first: sure, right") < text.index("warning: sure: covariances are")
    assert text.index("covariances decide this order") < text.index("tracker RMS-TGOSPA")
    assert "overconfident" in text
    document = json.loads(invoke(*asked, "--format", "json").out)
    assert any("covariances decide this order" in note for note in document["notes"])
    groups = {group["tracker"]: group for group in document["groups"]}
    for name, verdict in (("right", "consistent"), ("sure", "overconfident")):
        jobs = [job for job in document["jobs"] if job["label.tracker"] == name]
        joined = NeesSums.joined(NeesSums(**job["nees.sums"]) for job in jobs)
        assert joined is not None
        group = groups[name]
        assert group["nees"] == pytest.approx(joined.mean)
        assert (group["nees.lower"], group["nees.upper"]) == pytest.approx(band_of(joined))
        assert group["nees.verdict"] == joined.verdict == verdict
        for part in ("localisation_mean", "localisation_spread"):
            assert group[part] == pytest.approx(sum(job[part] for job in jobs))
    report = ("batch", "report", "out", "--by", "tracker")
    assert "| right" in invoke(*report, "--format", "markdown").out
    invoke(*report, "-o", "page")
    page = Path("page/report.html").read_text()
    assert "covariances decide this order" in page
    assert "overconfident" in page
    # A store is judged by the same rules; one without NEES says so.
    answer = invoke("gate", "out", "--fail-on", "nees:..2.5", "-q")
    assert answer.status == 1
    invoke(*asked[:5], "-c", "12", "-g", "5", "-q", "-o", "plain")
    answer = invoke("gate", "plain", "--fail-on", "nees:..2.5", "-q")
    assert answer.status == 2
    assert "the result has no NEES" in answer.out


def band_of(sums: NeesSums) -> tuple[float, float]:
    low, high = band(sums.independent, sums.components)
    return float(low), float(high)


# -------------------------------------------------------------------------------------------------
# Pictures.


def test_pictures_and_page_show_nees_over_time_and_ranks(invoke: Invoke) -> None:
    write_particles()
    result = evaluate("truth.csv", "cloud.csv", 12, 2, 5, with_="nees")
    above, below = result.plot_nees().axes
    (line,) = (line for line in above.lines if len(line.get_xdata()) == 30)
    assert np.asarray(line.get_ydata()) == pytest.approx(result.per_step["nees"].to_numpy())
    heights = [patch.get_data().values for patch in below.patches]
    assert [each.mean() for each in heights] == pytest.approx([1, 1])
    assert heights[1][[0, -1]].min() > 1.5  # y: particles are too close together
    for asked in (("--distance", "cloud-wasserstein", "-o", "out"), ("--with", "nees", *PICTURES)):
        assert invoke("truth.csv", "cloud.csv", *METRIC, *asked).status == 0
        page = Path("out/report.html").read_text()
        assert '<canvas id="nees"' in page
        assert '<canvas id="ranks"' in page
    assert Path("out/nees.png").read_bytes()[:4] == b"\x89PNG"
    assert invoke("truth.csv", "cloud.csv", *METRIC, *PICTURES).status == 0
    assert not Path("out/nees.png").exists()
    assert '<canvas id="nees"' not in Path("out/report.html").read_text()
    with pytest.raises(ConfigError, match="there is no NEES"):
        evaluate("truth.csv", "cloud.csv", 12, 2, 5).plot_nees()


def test_the_picture_of_costs_tells_means_from_spreads() -> None:
    write_sides("kf", 1.0, 1.0)
    result = evaluate("truth.csv", "kf.csv", 12, 2, 5, distance="gaussian-wasserstein")
    (axis,) = result.plot_costs().axes
    bars = {patch.get_label(): patch.get_data() for patch in axis.patches}
    height = {name: np.nansum(data.values - data.baseline) for name, data in bars.items()}
    assert height["means"] == pytest.approx(result.localisation_mean)
    assert height["spreads"] == pytest.approx(result.localisation_spread)


def test_on_a_common_clock_reports_are_judged_at_their_own_times(invoke: Invoke) -> None:
    write_sides("kf", 1.0, 1.0)
    asked = (*METRIC, "--resample", "1", "--max-gap", "4", "--format", "json")
    found = [
        json.loads(invoke("truth.csv", "kf.csv", *asked, *more).out)["nees"]
        for more in (GAUSSIAN, ("--with", "nees"))
    ]
    assert found[0]["mean"] == pytest.approx(found[1]["mean"])
    write_particles()
    answer = invoke("truth.csv", "cloud.csv", *asked, "--with", "nees")
    own = invoke("truth.csv", "cloud.csv", *METRIC, "--format", "json", "--with", "nees")
    found, plain = (json.loads(one.out)["nees"] for one in (answer, own))
    assert found["mean"] == pytest.approx(plain["mean"])  # the stamps are those of the clock


def test_nobody_is_judged_by_ignored_truths() -> None:
    write_sides("kf", 1.0, 1.0)
    truth = pd.read_csv("truth.csv")
    truth.assign(ignored=(truth["id"] == 3).astype(int)).to_csv("marked.csv", index=False)
    truth[truth["id"] != 3].to_csv("less.csv", index=False)
    for more in ({"distance": "gaussian-wasserstein"}, {"with_": "nees"}):
        all_of, marked, less = (
            evaluate(f"{name}.csv", "kf.csv", 12, 2, 5, **more, **ignore)
            for name, ignore in (("truth", {}), ("marked", {"ignore": "marked"}), ("less", {}))
        )
        assert all_of.nees is not None
        assert marked.nees is not None
        assert less.nees is not None
        assert marked.nees.plain() == {k: pytest.approx(v) for k, v in less.nees.plain().items()}
        assert marked.nees.pairs < all_of.nees.pairs
        assert marked.per_step["nees"].to_numpy() == pytest.approx(less.per_step["nees"].to_numpy())
