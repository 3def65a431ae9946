"""HOTA, CLEAR, Identity and per-step GOSPA: worked by hand, and by TrackEval alone."""

import io
import json
import math
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answer import Invoke, Write
from examples import seeds
from trackeval.metrics import CLEAR, HOTA, Identity

from tgospa_eval import Certified, ConfigError, Trajectories, evaluate
from tgospa_eval.common.progress import Stopwatch
from tgospa_eval.distances import DISTANCES, Resources
from tgospa_eval.evaluation.other_metrics import METRIC_FIELDS, joined, of_sums, other_metrics
from tgospa_eval.evaluation.prepare import fit, prepare
from tgospa_eval.evaluation.request import EvaluationRequest, chosen_parameters

TRUTH = "id,t,x\n" + "".join(f"1,{t},0\n" for t in (1, 2, 3, 4))
ESTIMATE = "id,t,x\n7,1,0\n7,2,0\n8,3,0.46\n9,4,100\n"
"""With c = 1 the similarities 1 - d / 2 of the one truth are 1, 1, 0.77, and 0 at the last step."""

QUIET = {"PRINT_CONFIG": False}

THREE, TWO = 15, 4
"""Thresholds up to 0.75, where three states match; and from 0.80, where two do."""


def known(write: Write, **options: Any) -> dict[str, Any]:
    paths = write("t.csv", TRUTH), write("e.csv", ESTIMATE)
    with_ = "gospa,identity,clear,hota"
    result = evaluate(*paths, cutoff=1, order=1, switch_penalty=1, with_=with_, **options)
    return json.loads(result.to_json())["with"]  # type: ignore[no-any-return]


def test_clear_by_hand(write: Write) -> None:
    """MOTA = 1 - (1 missed + 1 false + 1 switch) / 4; MOTP = mean similarity of the matches."""
    found = known(write)["clear"]
    assert (found["CLR_TP"], found["CLR_FN"], found["CLR_FP"], found["IDSW"]) == (3, 1, 1, 1)
    assert found["MOTA"] == 1 - 3 / 4
    assert found["MOTP"] == pytest.approx((1 + 1 + 0.77) / 3)
    assert (found["MT"], found["PT"], found["ML"], found["Frag"]) == (0, 1, 0, 0)


def test_identity_by_hand(write: Write) -> None:
    """The truth is best given to 7, with two of four steps: IDF1 = 2 * 2 / (2 * 2 + 2 + 2)."""
    found = known(write)["identity"]
    assert (found["IDTP"], found["IDFN"], found["IDFP"]) == (2, 2, 2)
    assert (found["IDF1"], found["IDP"], found["IDR"]) == (0.5, 0.5, 0.5)


def test_hota_by_hand(write: Write) -> None:
    """HOTA = root of DetA AssA at each threshold, then the mean over thresholds.

    Three matches: DetA = 3 / (3 + 1 + 1). Of 7 there are 2 among 4 rows of truth or 7, of 8 is
    1 of 4: AssA = (2 * 2/4 + 1/4) / 3 = 5/12. Two: DetA = 2 / (2 + 2 + 2), AssA = 2/4.
    """
    found = known(write)["hota"]

    def mean(three: float, two: float) -> float:
        return (THREE * three + TWO * two) / (THREE + TWO)

    assert found["DetA"] == pytest.approx(mean(3 / 5, 1 / 3))
    assert found["AssA"] == pytest.approx(mean(5 / 12, 1 / 2))
    assert found["HOTA"] == pytest.approx(mean(math.sqrt(3 / 5 * 5 / 12), math.sqrt(1 / 3 * 1 / 2)))
    assert found["LocA"] == pytest.approx(mean(2.77 / 3, 1))


def test_gospa_by_hand(write: Write) -> None:
    """Order 1: errors of 0.46, and c / 2 each for the missed and the false one."""
    assert known(write)["gospa"] == pytest.approx(
        {"localisation": 0.46, "missed": 0.5, "false": 0.5, "total": 1.46}
    )


@pytest.mark.parametrize(
    ("x", "y", "numbers", "rho", "value", "parts"),
    [
        ([0, 10], [1, 30], (5, 2), 0.5, 5.0990195, (1, 12.5, 12.5)),
        ([0, 10], [1, 30], (5, 1), 0.5, 6, (1, 2.5, 2.5)),
        ([0, 4], [2, 100], (3, 2), 0.5, 3.6055513, (4, 4.5, 4.5)),
        ([0, 10, 20], [1], (5, 2), 0.3, 6, (1, 35, 0)),
        ([0, 10, 20], [1], (5, 2), 0.7, 4, (1, 15, 0)),
    ],
)
def test_gospa_of_worked_examples(
    x: list[float],
    y: list[float],
    numbers: tuple[float, float],
    rho: float,
    value: float,
    parts: tuple[float, ...],
) -> None:
    """Twice, with the tracks exchanged at the second step: GOSPA does not see that."""
    truth, estimate = (np.array([own, own[::-1]], float)[..., None] for own in (x, y))
    result = evaluate(truth, estimate, *numbers, 1.0, rho=rho, with_="gospa")
    found = result.with_["gospa"]
    assert (found["total"] / 2) ** (1 / numbers[1]) == pytest.approx(value, abs=1e-7)
    names = ("localisation", "missed", "false")
    assert [found[name] / 2 for name in names] == pytest.approx(parts)


@pytest.mark.parametrize("cutoff", ["0.5", "1"])
def test_boxes_match_by_their_overlap_whatever_the_cutoff(
    write: Write, invoke: Invoke, cutoff: str
) -> None:
    """Boxes of width 10 moved by 2 and by 5: IoU 8/12, which matches, and 5/15, which does not.

    HOTA: up to 0.30 both match, and it is 1; up to 0.65 one of two, DetA = AssA = 1/3; then 0.
    """
    head = "id,t,left,top,width,height\n"
    truth = write("t.csv", f"{head}1,1,0,0,10,10\n1,2,0,0,10,10\n")
    estimate = write("e.csv", f"{head}7,1,2,0,10,10\n7,2,5,0,10,10\n")
    answer = invoke(truth, estimate, "--distance", "iou", "-c", cutoff, "--format", "json", "-q",
                    "--with", "hota,clear,identity")  # fmt: skip
    found = json.loads(answer.out)["with"]
    assert found["similarity"] == {"zero": 1, "threshold": 0.5}
    assert found["clear"]["MOTP"] == pytest.approx(8 / 12)
    assert (found["clear"]["MOTA"], found["identity"]["IDF1"]) == (1 - 2 / 2, 2 / 4)
    assert found["hota"]["HOTA"] == pytest.approx((6 + 7 / 3) / 19)


def scene(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Two sets of tracks with holes, (T, k, 2); one of each never exists."""
    truth = rng.uniform(0, 20, (12, 5, 2))
    estimate = np.concatenate((truth + rng.normal(0, 2, truth.shape), truth[:, :2]), axis=1)
    for side in (truth, estimate):
        side[rng.random(side.shape[:2]) < 0.3] = np.nan
        side[:, 1] = np.nan
    truth[5] = estimate[8] = np.nan
    return truth, estimate


@pytest.mark.parametrize("seed", range(5))
def test_the_same_numbers_as_by_all_pairs(seed: int) -> None:
    """What TrackEval makes of matrices of all distances, none of them searched for."""
    sides, c = scene(np.random.default_rng(seed)), 3.0
    there = [~np.isnan(side[:, :, 0]) for side in sides]
    ids = [[np.cumsum(own.any(axis=0))[row] - 1 for row in own] for own in there]
    data: dict[str, Any] = {
        "num_timesteps": 12,
        "gt_ids": ids[0],
        "tracker_ids": ids[1],
        "similarity_scores": [
            np.maximum(0, 1 - np.linalg.norm(x[a][:, None] - y[b], axis=2) / (2 * c))
            for x, y, a, b in zip(*sides, *there, strict=True)
        ],
    }
    for name, own in zip(("gt", "tracker"), there, strict=True):
        data |= {f"num_{name}_ids": own.any(axis=0).sum(), f"num_{name}_dets": own.sum()}
    metrics = {"hota": HOTA(), "clear": CLEAR(QUIET), "identity": Identity(QUIET)}
    found = evaluate(*sides, cutoff=c, switch_penalty=1, with_=tuple(metrics)).with_
    for name, metric in metrics.items():
        expected = metric.eval_sequence(data)
        for field, value in found[name].items():
            assert value == pytest.approx(np.mean(expected[field]), abs=1e-12), (name, field)


def test_sums_join_as_trackeval_joins(tmp_path: Path) -> None:
    """What is stored of each sequence is enough for its own COMBINED, to the last bit."""
    metrics = {"hota": HOTA(), "clear": CLEAR(QUIET), "identity": Identity(QUIET)}
    whole, stored = [], []
    for seed in range(3):
        sides = [Trajectories.from_array(side) for side in scene(np.random.default_rng(seed))]
        if seed == 2:
            sides[1] = Trajectories.from_array(np.full((12, 1, 2), np.nan))  # nothing reported
        parameters, _ = chosen_parameters(DISTANCES["euclidean"], 2, 3.0, 1.0)
        asked = EvaluationRequest(
            parameters=parameters, distance=DISTANCES["euclidean"], solver=Certified()
        )
        prepared = prepare(fit(*sides, asked), asked, stopwatch=Stopwatch())
        others = other_metrics(prepared, tuple(metrics), Resources(jobs=1, stopwatch=Stopwatch()))
        whole.append(others.by_name)
        kept = json.loads(json.dumps(others.sums()))
        stored.append(of_sums(kept, metrics, others.zero))
    found = joined(stored)
    for name, metric in metrics.items():
        expected = metric.combine_sequences({str(k): each[name] for k, each in enumerate(whole)})
        for key in METRIC_FIELDS[name]:
            assert found[name][key] == np.mean(expected[key])


def test_runs_are_joined_by_their_counts(tmp_path: Path, invoke: Invoke) -> None:
    """4 states with three faults and 2 without: MOTA = 1 - 3/6, not the mean of 1/4 and 1."""
    for run, truth, estimate in (("1", TRUTH, ESTIMATE), ("2", "id,t,x\n1,1,0\n1,2,0\n", None)):
        folder = tmp_path / f"run{run}"
        folder.mkdir()
        (folder / "t.csv").write_text(truth, encoding="utf-8")
        (folder / "a.csv").write_text(estimate or truth, encoding="utf-8")
    args = ("compare", f"{tmp_path}/run*/t.csv", f"{tmp_path}/run*/a.csv", "-c", "1", "-p", "1",
            "-g", "1", "-q", "--with", "clear,gospa,identity", "--format")  # fmt: skip
    document = json.loads(invoke(*args, "json").out)
    (item,) = document["estimates"]
    assert item["with"]["clear"]["MOTA"] == 1 - 3 / 6
    assert item["with"]["identity"]["IDF1"] == 2 * 4 / (2 * 4 + 2 + 2)
    assert item["with"]["gospa"]["total"] == pytest.approx(1.46 / 2)
    head, row = (line.split(",") for line in invoke(*args, "csv").out.splitlines())
    assert float(row[head.index("clear_MOTA")]) == 0.5


@pytest.mark.parametrize("form", ["table", "markdown", "latex"])
def test_what_is_printed(write: Write, invoke: Invoke, form: str) -> None:
    paths = write("t.csv", TRUTH), write("e.csv", ESTIMATE)
    options = ("-c", "1", "-p", "1", "-g", "1", "-q", "--format", form)
    plain = invoke(*paths, *options)
    answer = invoke(*paths, *options, "--with", "clear,gospa")
    assert (answer.status, plain.status) == (0, 0)
    assert "MOTA" not in plain.out
    for part in ("25.00", "MOTP 92.33", "GOSPA", "1.46", "d <= 1" if form != "markdown" else "d "):
        assert part in answer.out
    assert "HOTA" not in answer.out
    ranked = invoke("compare", *paths, write("f.csv", TRUTH), *options, "--with", "clear,gospa")
    assert [text in ranked.out for text in ("MOTA", "GOSPA", "IDF1")] == [True, True, False]
    best = {"markdown": "**100.00 %**", "latex": r"\textbf{100.00 \%}"}.get(form, "100.00 %")
    assert ranked.out.count(best) == 2  # MOTA and MOTP of the second


def test_the_page_has_them(write: Write) -> None:
    paths = write("t.csv", TRUTH), write("e.csv", ESTIMATE)
    plain, page = (
        evaluate(*paths, cutoff=1, order=1, switch_penalty=1, with_=names).to_html()
        for names in ((), "clear")
    )
    row = '<tr><th scope="row"><bdi>MOTA</bdi></th><td>25.00 %</td><td>high</td>'
    assert (row in page, "MOTA" in plain) == (True, False)


def test_wrong_uses(write: Write, invoke: Invoke) -> None:
    paths = write("t.csv", TRUTH), write("e.csv", ESTIMATE)
    for words, text in (
        (["--with", "motq"], '--with "motq": must be of hota, clear, identity, gospa'),
        (["--with", "hota", "--by", "class"], "--class NAME chooses one class"),
        (["--with", "hota", "--sweep", "c=1,2"], "is not supported with --sweep"),
    ):
        answer = invoke(*paths, *words)
        assert answer.status == 2
        assert text in answer.err
    with pytest.raises(ConfigError, match=r'^with_ "x"'):
        evaluate(*paths, with_=["x"])
    assert invoke(*paths, "--with", "gospa").status == 0


def test_empty_sides(write: Write) -> None:
    """As TrackEval has it: nothing is missed, and nothing is found."""
    truth, empty = write("t.csv", TRUTH), write("e.csv", "id,t,x\n")
    result = evaluate(truth, empty, cutoff=1, with_=("clear", "hota", "identity"))
    named = evaluate(truth, empty, cutoff=1, with_="idf1,mota,hota")
    assert named.with_ == result.with_
    found = result.with_
    assert result.metrics()["with.clear.CLR_FN"] == 4
    assert found["clear"]["CLR_FN"] == found["identity"]["IDFN"] == 4
    assert (found["hota"]["HOTA"], found["clear"]["MOTA"]) == (0, 0)


# --- boxes, as TrackEval has them -----------------------------------------------------------------

THRESHOLDS = (
    ("944.1,658.4,71.4,245.5", "1008.7"),  # 0.05
    ("941.2,934.8,86.1,43.9", "998.6"),  # 0.2
    ("983.8,554.1,62.4,178.2", "1017.4"),  # 0.3
    ("485.8,760.4,142.2,55.5", "533.2"),  # 0.5, that of CLEAR and Identity too
    ("144.7,337.8,72.6,292.0", "168.9"),  # 0.5
    ("964.7,158.2,65.1,96.8", "983.6"),  # 0.55
    ("47.0,255.7,32.9,255.9", "51.7"),  # 0.75
    ("999.3,83.4,140.4,53.9", "1002.9"),  # 0.95
)
"""Boxes, and where the left edge of the estimate is: as decimals their IoU is a threshold."""


def by_trackeval(folder: Path, truth: str, estimate: str, steps: int) -> dict[str, dict[str, Any]]:
    """What TrackEval itself makes of two MOTChallenge files."""
    with redirect_stdout(io.StringIO()):
        from trackeval.datasets import MotChallenge2DBox

        for name, text in (("gt/s/gt/gt.txt", truth), ("out/t/data/s.txt", estimate)):
            (folder / name).parent.mkdir(parents=True)
            (folder / name).write_text(text, encoding="utf-8")
        data = MotChallenge2DBox(
            {
                "GT_FOLDER": str(folder / "gt"),
                "TRACKERS_FOLDER": str(folder / "out"),
                "SEQ_INFO": {"s": steps},
                "SKIP_SPLIT_FOL": True,
                **QUIET,
            }
        )
        raw = data.get_raw_seq_data("t", "s")
        sequence = data.get_preprocessed_seq_data(raw, "pedestrian")
        metrics = {"hota": HOTA(), "clear": CLEAR(QUIET), "identity": Identity(QUIET)}
        return {name: metric.eval_sequence(sequence) for name, metric in metrics.items()}


def test_boxes_at_a_threshold_match_as_in_trackeval(
    invoke: Invoke, tmp_path: Path, write: Write
) -> None:
    """Its edges are rounded first: of these boxes some match there whose IoU is below, or above."""
    texts, steps = ["", ""], 4 * len(THRESHOLDS)
    for step in range(1, steps + 1):
        box, left = THRESHOLDS[step % len(THRESHOLDS)]
        kind = 12 if step > 3 * len(THRESHOLDS) else 1  # each is on a reflection, too
        texts[0] += f"{step},{step % 3},{box},1,{kind},1\n"
        texts[1] += f"{step},{step % 2},{left},{box.split(',', 1)[1]},1,-1,-1,-1\n"
    expected = by_trackeval(tmp_path, *texts, steps)
    answer = invoke(write("gt.txt", texts[0]), write("out.txt", texts[1]), "--distance", "iou",
                    "--preprocess", "motchallenge", "--with", "hota,clear,identity",
                    "--format", "json")  # fmt: skip
    found = json.loads(answer.out)["with"]
    for name, fields in METRIC_FIELDS.items():
        for field in fields:
            value = np.mean(expected[name][field])
            assert found[name][field] == value, (name, field)


def with_ties(rng: np.random.Generator, steps: int) -> tuple[str, str]:
    """Boxes of one size on a coarse grid, so that sums are equal, in rows of no order."""
    texts = []
    for end in ("{flag},{kind},1", "1,-1,-1,-1"):
        rows = []
        for step in range(1, steps + 1):
            for name in rng.permutation(12)[: rng.integers(1, 6)]:
                x, y = 5 * rng.integers(0, 3, 2)
                flag, kind = int(rng.random() < 0.8), rng.choice([1, 1, 8, 12, 7])
                own = end.format(flag=flag, kind=kind)
                rows.append(f"{step},{name},{x},{y},20,20,{own}\n")
        rng.shuffle(rows)
        texts.append("".join(rows))
    return texts[0], texts[1]


@pytest.mark.parametrize("seed", seeds(5, 12))
def test_ties_are_broken_by_the_order_of_the_rows_as_in_trackeval(
    invoke: Invoke, tmp_path: Path, write: Write, seed: int
) -> None:
    steps = 6
    texts = with_ties(np.random.default_rng(seed), steps)
    expected = by_trackeval(tmp_path, *texts, steps)
    answer = invoke(write("gt.txt", texts[0]), write("out.txt", texts[1]), "--distance", "iou",
                    "--preprocess", "motchallenge", "--with", "hota,clear,identity",
                    "--format", "json")  # fmt: skip
    found = json.loads(answer.out)["with"]
    for name, fields in METRIC_FIELDS.items():
        for field in fields:
            value = np.mean(expected[name][field])
            assert found[name][field] == value, (name, field)


def test_boxes_at_the_ends_of_the_numbers(write: Write, invoke: Invoke) -> None:
    head = "id,t,left,top,width,height\n"
    truth = write("t.csv", f"{head}1,1,-1.7e308,0,1e150,1e150\n1,2,0,0,1e150,1e150\n")
    estimate = write("e.csv", f"{head}7,1,1.7e308,0,1e150,1e150\n7,2,0,0,1e150,1e150\n")
    answer = invoke(truth, estimate, "--distance", "iou", "--format", "json", "--with", "clear")
    found = json.loads(answer.out)["with"]["clear"]
    assert (found["CLR_TP"], found["CLR_FN"], found["CLR_FP"]) == (1, 1, 1)
    assert "overflow" not in answer.err


# --- what MOTChallenge leaves out -----------------------------------------------------------------

MOT_TRUTH = """\
1,1,0,0,10,10,1,1,1
1,2,100,0,10,10,0,12,1
1,3,200,0,10,10,1,7,1
1,4,300,0,10,10,0,8,1
1,5,303,0,10,10,1,1,1
2,2,100,0,10,10,0,1,1
"""
MOT_RESULTS = """\
1,21,1,0,10,10,0.9,-1,-1,-1
1,22,101,0,10,10,0.9,-1,-1,-1
1,23,204,0,10,10,0.9,-1,-1,-1
1,24,302,0,10,10,0.9,-1,-1,-1
2,22,101,0,10,10,0.9,-1,-1,-1
"""
"""22 is on a reflection, and then on a pedestrian that does not count; 23 is not near enough to the
static person (an IoU of 6/14); 24 is nearer to the pedestrian 5 than to the distractor 4."""


def test_preprocessing_by_hand(write: Write, invoke: Invoke, tmp_path: Path) -> None:
    """Left out are 22 at the first step, and 3; 23, and 22 at the second step, are false."""
    paths = write("gt.txt", MOT_TRUTH), write("results.txt", MOT_RESULTS)
    options = ("--distance", "iou", "-c", "0.5", "-g", "0.5", "--with", "clear")
    folder = str(tmp_path / "result")
    args = (*paths, *options, "--preprocess", "motchallenge")
    answer = invoke(*args, "--format", "json", "-o", folder, "--proof", "--pictures", "none")
    found = json.loads(answer.out)
    assert found["input"]["truth"]["left_out"] == {"not considered": 3, "preprocess": 1}
    assert found["input"]["estimate"]["left_out"] == {"preprocess": 1}
    assert "results.txt: 1 row left out by --preprocess" in answer.err
    assert found["parameters"]["preprocess"] == "motchallenge"
    assert found["counts"] == {"missed": 0, "false": 2, "switch": 0}
    assert [found["with"]["clear"][f"CLR_{n}"] for n in ("TP", "FN", "FP")] == [2, 0, 2]
    assert invoke("verify", folder, *paths).status == 0
    ranked = json.loads(invoke("compare", *args, "--format", "json").out)
    assert ranked["estimates"][0]["counts"] == found["counts"]
    assert ranked["estimates"][0]["with"] == found["with"]
    plain = json.loads(invoke(*paths, *options, "--format", "json").out)
    assert plain["counts"] == {"missed": 1, "false": 3, "switch": 0}


@pytest.mark.parametrize("filters", [(), ("--class", "1")])
def test_numbers_of_tables_without_their_rules_get_a_warning(
    write: Write, invoke: Invoke, filters: tuple[str, ...]
) -> None:
    paths = write("gt.txt", MOT_TRUTH), write("results.txt", MOT_RESULTS)
    asked = (*paths, "--distance", "iou", "--format", "json", *filters)
    answer = invoke(*asked, "--with", "hota", "-q")
    (warning,) = json.loads(answer.out)["warnings"]
    assert warning["code"] == "benchmark-rules"
    assert "gt.txt: 3 boxes are distractors (classes 2, 7, 8, 12)" in warning["text"]
    assert warning["remedy"].startswith("--preprocess motchallenge ")
    assert f"warning: {warning['text']}; {warning['remedy']}" in answer.err
    ranked = invoke("compare", *asked, write("other.txt", MOT_RESULTS), "--with", "clear")
    assert [found["code"] for found in json.loads(ranked.out)["warnings"]] == ["benchmark-rules"]
    for others in (
        ("--with", "hota", "--preprocess", "motchallenge"),
        ("--with", "gospa"),
        (),
    ):
        assert json.loads(invoke(*asked, *others).out)["warnings"] == []
    # Where nothing is a distractor, or no class is known, there is nothing to say.
    for truth in (MOT_RESULTS, "1,1,0,0,10,10,1,1,1\n1,2,100,0,10,10,0,3,1\n", "1,1,0,0,9,9\n"):
        clean = invoke(write("clean.txt", truth), *asked[1:6], "--with", "hota")
        codes = [found["code"] for found in json.loads(clean.out)["warnings"]]
        assert "benchmark-rules" not in codes


def test_tables_of_kitti_leave_out_more_than_is_done_here(write: Write, invoke: Invoke) -> None:
    car = "0 1 Car 0 0 -1.8 100 50 140 80 2.0 1.8 4.4 -4.5 1.5 13.5 -2.1\n"
    region = "0 -1 DontCare -1 -1 -10 219 188 245 218 -1000 -1000 -1000 -10 -1 -1 -1\n"
    paths = write("gt.txt", car + region), write("results.txt", car)
    asked = ("--distance", "iou", "--with", "hota", "--format", "json")
    (warning,) = json.loads(invoke(*paths, *asked).out)["warnings"]
    assert warning["code"] == "benchmark-rules"
    assert "in DontCare regions" in warning["text"]
    assert json.loads(invoke(paths[1], paths[1], *asked).out)["warnings"] == []


def test_wrong_uses_of_preprocessing(write: Write, invoke: Invoke) -> None:
    mot = write("gt.txt", MOT_TRUTH)
    table = write("t.csv", "id,t,left,top,width,height\n1,1,0,0,10,10\n")
    bare = write("bare.txt", "1,1,0,0,10,10,1\n")
    minus = write("minus.txt", "1,1,0,0,10,10,1,-1,-1\n")
    boxes = write("boxes.csv", "id,t,left,top,width,height,class\n1,1,0,0,10,10,1\n")
    for words, text in (
        ([mot, mot], "choose --distance iou"),
        ([mot, mot, "--distance", "iou", "--by", "class"], "leave out --by class"),
        ([table, mot, "--distance", "iou"], "no column class for --preprocess"),
        ([bare, mot, "--distance", "iou"], "no column class for --preprocess"),
        ([minus, mot, "--distance", "iou"], "minus.txt has no classes"),
        ([boxes, mot, "--distance", "iou"], "boxes.csv is read as csv"),
    ):
        answer = invoke(*words, "--preprocess", "motchallenge")
        assert answer.status == (3 if "column" in text else 2)
        assert text in answer.err
