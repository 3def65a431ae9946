"""What a batch says of trackers: by hand, against all sign flips, with brackets."""

import itertools
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from examples import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from tgospa_eval.campaign.statistics import (
    PERMUTATION_SEED,
    PERMUTATIONS,
    holm,
    intervals,
    p_values,
)
from tgospa_eval.campaign.sums import tabulated
from tgospa_eval.show.batch import BatchTables, Ranking, batch_report
from tgospa_eval.show.result_text import REPORTS

COLUMNS = {
    "status": "done", "certified": True, "distance": "euclidean", "cutoff": 5.0, "order": 2.0,
    "switch_penalty": 1.0, "localisation": 1.0, "missed": 0.0, "false": 0.0, "switch": 0.0,
    "counts.missed": 0.0, "counts.false": 0.0, "counts.switch": 0.0, "judged.steps": 10.0,
    "judged.steps_sha256": "s", "judged.truth_sha256": "t", "judged.truth_states": 5,
    "judged.truth_steps": 5, "parameters": "{}",
    "options": "{}", "finished": 1,
}  # fmt: skip


def job(tracker: str, sequence: str, total: float, width: float = 0.0, **more: object) -> dict:
    """A row of a store."""
    totals = {"total_lower": total - width, "total": total, "total_upper": total + width}
    labels = {"label.tracker": tracker, "label.sequence": sequence, "truth": f"gt/{sequence}"}
    return COLUMNS | labels | totals | more


def table(totals: dict[str, Sequence[float]], **more: object) -> pd.DataFrame:
    """Rows of trackers, of which each has a total for each sequence."""
    return pd.DataFrame(
        [
            job(tracker, f"s{k}", total, **more)
            for tracker, values in totals.items()
            for k, total in enumerate(values)
        ]
    )


def failed(rows: pd.DataFrame, which: Iterable[int]) -> pd.DataFrame:
    """The rows, of which some failed."""
    rows = rows.copy()
    having = [*rows.columns[rows.columns.str.startswith(("total", "counts", "judged"))], "cutoff",
              "distance", "order", "switch_penalty"]  # fmt: skip
    rows[having] = rows[having].astype(object)
    rows.loc[list(which), having] = None
    rows.loc[list(which), "status"] = "failed"
    return rows.infer_objects()


def only(tables: BatchTables) -> Ranking:
    (ranking,) = tables.rankings
    return ranking


def words(tables: BatchTables) -> str:
    """What is printed, without its lines."""
    return " ".join(batch_report(tables, "table").split())


DRAWN = np.random.default_rng(5)
A = DRAWN.gamma(4.0, 25.0, 8)
B = A + DRAWN.normal(20.0, 15.0, 8)
C = A + DRAWN.normal(0.0, 15.0, 8)


# --- resampling -----------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [6, 8])
def test_p_values_are_those_of_all_sign_flips(size: int) -> None:
    differences = np.stack([(B - A)[:size], (C - A)[:size], np.zeros(size)])
    flips = np.array(list(itertools.product((1.0, -1.0), repeat=size)))
    for found, row in zip(p_values(differences, differences), differences, strict=True):
        sums, observed = flips @ row, row.sum()
        tails = [(sums <= observed + 1e-9).mean(), (sums >= observed - 1e-9).mean()]
        assert found == min(1.0, 2 * min(tails))


def test_p_values_of_many_pairs_are_those_of_scipy() -> None:
    differences = np.random.default_rng(1).normal(0.2, 1.0, (3, 40))
    direct = stats.permutation_test(
        (differences,),
        np.sum,
        permutation_type="samples",
        n_resamples=PERMUTATIONS,
        axis=-1,
        random_state=np.random.default_rng(PERMUTATION_SEED),
    )
    # Other flips are drawn: four standard deviations of the difference of two such shares.
    spread = 4 * np.sqrt(2 * direct.pvalue / PERMUTATIONS)
    assert (np.abs(p_values(differences, differences) - direct.pvalue) < 2 * spread).all()


def test_p_values_hold_for_all_differences_between_the_bounds() -> None:
    rng = np.random.default_rng(2)
    lower = rng.normal(0.5, 1.0, (1, 8))
    upper = lower + rng.uniform(0.0, 0.3, 8)
    widest = p_values(lower, upper)
    for _ in range(50):
        inside = rng.uniform(lower, upper)
        assert p_values(inside, inside) <= widest


LAWS = {
    "lognormal": (lambda rng, size: rng.lognormal(0.0, 0.5, size), np.exp(0.125)),
    "exponential": (lambda rng, size: rng.exponential(1.0, size), 1.0),
    "normal": (lambda rng, size: np.maximum(rng.normal(1.0, 0.25, size), 0.0), 1.0),
}


@pytest.mark.parametrize("law", LAWS)
def test_intervals_of_few_pairs_cover(law: str) -> None:
    """Of studies of six truths nearly 95 % have the mean of all truths between the ends."""
    draw, mean = LAWS[law]
    size, studies = 6, 400
    totals = draw(np.random.default_rng(0), (studies, size))
    rows = table({str(k): values for k, values in enumerate(totals)})
    groups = tabulated(rows, ["tracker"]).groups
    true = (size * mean) ** 0.5
    covered = (groups["confidence_lower"] <= true) & (true <= groups["confidence_upper"])
    assert 0.91 <= covered.mean() <= 0.98


def jackknife(function: Callable[[np.ndarray], float], size: int) -> float:
    """Half width by Student's t, of a function of which truths there are, one by one."""
    without = [function(np.delete(np.arange(size), k)) for k in range(size)]
    error = np.sqrt((size - 1) / size * np.sum((without - np.mean(without)) ** 2))
    return float(stats.t.ppf(0.975, size - 1) * error)


@settings(max_examples=examples(10))
@given(seed=st.integers(0, 99), order=st.sampled_from([1.0, 2.0, 3.5]))
def test_intervals_hold_for_all_totals_between_the_bounds(seed: int, order: float) -> None:
    rng = np.random.default_rng(seed)
    lower = rng.gamma(0.5, 25.0, (1, 8))
    upper = lower + rng.uniform(0.0, rng.choice([1e-9, 1.0, 100.0]), 8)
    low, high = intervals(lower, upper, order)
    for inside in (lower, upper, *rng.uniform(lower, upper, (20, 8))):
        ends = intervals(inside.reshape(1, 8), inside.reshape(1, 8), order)
        assert low <= ends[0] * (1 + 1e-12)
        assert ends[1] <= high * (1 + 1e-12)


def test_equal_and_absent_costs_have_intervals_too() -> None:
    totals = {"a": [0.0] * 6, "b": [4.0] * 6, "c": [9.0] + [0.0] * 5}
    ends = tabulated(table(totals), ["tracker"]).groups[["confidence_lower", "confidence_upper"]]
    none, same, one = ends.to_numpy()
    assert none.tolist() == [0.0, 0.0]
    assert same == pytest.approx([24**0.5, 24**0.5])
    assert 0 < one[0] < 3 < one[1] < 3 * np.exp(stats.t.ppf(0.975, 5))


def test_holm_by_hand() -> None:
    # Sorted .01 x 4, .02 x 3, .03 x 2, .4 x 1; never below those before.
    found = holm(np.array([0.03, 0.01, 0.4, 0.02]))
    assert found == pytest.approx([0.06, 0.04, 0.4, 0.06])
    assert holm(np.array([0.9, 0.8])) == pytest.approx([1.0, 1.0])


# --- rankings -------------------------------------------------------------------------------------


def test_ranking_and_interval_by_hand() -> None:
    tables = tabulated(table({"c": C, "a": A, "b": B}), ["tracker"])
    ranking = only(tables)
    best = sorted({"a": A, "b": B, "c": C}.items(), key=lambda item: item[1].sum())
    assert [item["name"] for item in ranking.entries] == [name for name, _ in best]
    assert [item["place"] for item in ranking.entries] == [(1, 1), (2, 2), (3, 3)]
    assert (ranking.jobs, ranking.pairs, ranking.permutations) == (8, 8, 256)
    assert [item["combined"] for item in ranking.entries] == pytest.approx(
        [total.sum() ** 0.5 for _, total in best]
    )
    assert ranking.entries[0]["per_step"] == pytest.approx((best[0][1].sum() / 80) ** 0.5)
    comparison = ranking.comparisons[1]
    first, last = (dict(best)[comparison[name]] for name in ("first", "second"))

    def value(totals: np.ndarray, there: np.ndarray) -> float:
        return float((8 * totals[there].mean()) ** 0.5)

    half = jackknife(lambda there: value(last, there) - value(first, there), 8)
    apart = last.sum() ** 0.5 - first.sum() ** 0.5
    assert (comparison["lower"], comparison["upper"]) == pytest.approx((apart - half, apart + half))
    own, combined = ranking.entries[0]["confidence"], first.sum() ** 0.5
    ratio = np.exp(jackknife(lambda there: value(first, there), 8) / combined)
    assert own == pytest.approx([combined / ratio, combined * ratio])
    group = tables.groups[tables.groups["tracker"] == comparison["first"]].iloc[0]
    assert [group["confidence_lower"], group["confidence_upper"]] == pytest.approx(own)


def test_brackets_travel() -> None:
    totals = {"a": A, "b": A + 20}
    exact, wide = (only(tabulated(table(totals, width=w), ["tracker"])) for w in (0.0, 8.0))
    for narrow, open_ in zip(exact.entries, wide.entries, strict=True):
        for value in ("combined", "per_step"):
            assert open_[f"{value}_lower"] < narrow[f"{value}_lower"]
            assert narrow[value] < open_[value]
        assert open_["confidence"][0] < narrow["confidence"][0]
        assert narrow["confidence"][1] < open_["confidence"][1]
    (before,), (after,) = exact.comparisons, wide.comparisons
    assert (before["verdict"], after["verdict"]) == ("less", "less")
    assert after["difference"][0] < before["difference"][0] < after["difference"][1]
    assert before["p_value"] == 2 / 2**8 == after["p_value"]
    assert after["lower"] < before["lower"]
    (undecided,) = only(tabulated(table(totals, width=15.0), ["tracker"])).comparisons
    assert (undecided["verdict"], undecided["p_value"]) == ("not separated", 1.0)


def test_too_few_pairs() -> None:
    tables = tabulated(table({"a": A[:5], "b": B[:5]}), ["tracker"])
    ranking = only(tables)
    assert [item["place"] for item in ranking.entries] == [(1, 1), (2, 2)]
    assert all(item["confidence"] is item["statistical_place"] is None for item in ranking.entries)
    assert ranking.comparisons[0]["p_value"] is None
    assert ranking.permutations == 0
    text = words(tables)
    assert "5 pairs: at least 6 are needed for a test about other scenes" in text
    assert "interval" not in text
    (row,) = json.loads(batch_report(tables, "json"))["comparisons"]
    assert row["p_value"] is row["lower"] is row["significant"] is None


def test_runs_of_one_truth_count_once() -> None:
    # Four runs of each of three truths: three pairs, whatever the number of runs.
    rows = pd.DataFrame(
        [
            job(tracker, f"r{k}", 9.0 + add, truth=f"gt/{k % 3}")
            for tracker, add in (("a", 0), ("b", 1))
            for k in range(12)
        ]
    )
    ranking = only(tabulated(rows, ["tracker"]))
    assert (ranking.jobs, ranking.pairs, ranking.permutations) == (12, 3, 0)
    rows["truth"] = "gt"  # one truth alone: its runs are what is drawn
    ranking = only(tabulated(rows, ["tracker"]))
    assert (ranking.jobs, ranking.pairs) == (12, 12)
    assert "to the best, for other runs of this scene drawn as these were" in words(
        tabulated(rows, ["tracker"])
    )


def test_ties_share_their_places() -> None:
    tables = tabulated(table({"b": A, "c": A + 20, "a": A}), ["tracker"])
    assert [(item["name"], item["place"]) for item in only(tables).entries] == [
        ("a", (1, 1)), ("b", (1, 1)), ("c", (3, 3))
    ]  # fmt: skip
    text = batch_report(tables, "table")
    assert "Proven order of these files by RMS-TGOSPA, best first: a = b, c (8 jobs each)" in text
    rows = [line.split() for line in text.splitlines() if line.endswith(" 1=")]
    assert [(row[0], row[-1]) for row in rows] == [("a", "1="), ("b", "1=")]
    assert "no significant difference at the top between a, b" in text
    # Equal data have equal values, whatever the brackets are.
    rows = table({"a": A, "b": A}, width=3.0, **{"input.estimate.sha256": "1"})
    (pair,) = only(tabulated(rows, ["tracker"])).comparisons
    assert (pair["verdict"], pair["difference"]) == ("equal", [0.0, 0.0])
    assert (pair["p_value"], pair["lower"], pair["upper"]) == (1.0, 0.0, 0.0)


def test_only_common_jobs_are_compared() -> None:
    rows = table({"a": A, "b": A / 2, "c": A})
    tables = tabulated(failed(rows, [8, 9, *range(16, 24)]), ["tracker"])
    ranking = only(tables)
    # Of b two jobs failed, of c all: b is still the better one, on what both have.
    assert (ranking.jobs, ranking.all_jobs, ranking.left_out) == (6, 8, ("c",))
    assert [item["combined"] for item in ranking.entries] == pytest.approx(
        [(A[2:].sum() / 2) ** 0.5, A[2:].sum() ** 0.5]
    )
    assert tables.groups["jobs"].tolist() == [8, 6, 0]
    assert tables.groups["expected"].tolist() == [8, 8, 8]
    assert words(tables).count("the other jobs have no value") == 1
    for part in (
        "6 of 8",
        "0 of 8",
        "over the 6 jobs that all 2 have, of 8",
        "c: not ranked, no job has a value",
    ):
        assert part in words(tables)
    # Jobs that were never there are missed as well.
    assert tabulated(rows.drop([8, 9]), ["tracker"]).groups["expected"].tolist() == [8, 8, 8]
    # Sequences are no trackers: one of them is not expected to have the jobs of another.
    assert tabulated(rows.drop([8, 9]), ["sequence"]).groups["expected"].tolist() == [3] * 8
    # The truth of a sequence is not the same for all: each tracker still has all of its jobs.
    rows.loc[9, "truth"] = "other/s1"
    tables = tabulated(rows[:16], ["tracker"])
    assert (only(tables).jobs, only(tables).all_jobs) == (7, 8)
    assert tables.groups["expected"].tolist() == [8, 8]
    assert tables.notes == (
        "warning: 1 job of each tracker cannot be compared, as the truth is not the same: "
        "gt/s1 of a and other/s1 of b",
    )


def test_parameters_are_ranked_apart() -> None:
    rows = pd.concat([table({"a": A, "b": B}), table({"a": B, "b": A}, cutoff=9.0)])
    tables = tabulated(rows.reset_index(drop=True), ["tracker"])
    assert [dict(ranking.parameters) for ranking in tables.rankings] == [
        {"cutoff": 5.0}, {"cutoff": 9.0}
    ]  # fmt: skip
    assert [ranking.entries[0]["name"] for ranking in tables.rankings] == ["a", "b"]
    text = batch_report(tables, "table")
    assert "cutoff 9: Proven order of these files by RMS-TGOSPA" in text
    lines = text.splitlines()
    begin = next(k for k, line in enumerate(lines) if line.startswith("  tracker  cutoff"))
    rows = [line.split() for line in lines[begin + 1 : begin + 5]]
    assert [row[:2] for row in rows] == [["a", "5"], ["b", "5"], ["b", "9"], ["a", "9"]]


def test_other_parameters_are_other_groups_too() -> None:
    """Those of the result that no column has; how files are read may be each job's own."""
    scale = {"x": 2.0, "y": 1.0}
    texts = [
        json.dumps({"grid": "union", "unit": "m", "time": "0:1"}),
        json.dumps({"grid": "truth", "unit": "km", "time": "1:2", "scale": scale}),
    ]
    rows = table({"a": [1.0], "b": [4.0]}).assign(parameters=texts[0])
    more = table({"a": [4.0], "b": [1.0]}).assign(parameters=texts[1], options='{"grid": "truth"}')
    lost = failed(table({"c": [1.0]}), [0])
    tables = tabulated(pd.concat([rows, more, lost], ignore_index=True), ["tracker"])
    assert tables.parameters == ("grid", "scale", "unit")
    assert [
        (row["tracker"], row["grid"], row["combined"]) for row in tables.groups.to_dict("records")
    ] == [
        ("a", "truth", 2.0),
        ("a", "union", 1.0),
        ("b", "truth", 1.0),
        ("b", "union", 2.0),
    ]
    assert [[entry["name"] for entry in item.entries] for item in tables.rankings] == [
        ["b", "a"],
        ["a", "b"],
    ]
    assert {item.left_out for item in tables.rankings} == {("c",)}
    assert (
        "grid truth, scale x=2,y=1, unit km: Proven order of these files by TGOSPA per step, best "
        "first: b, a" in words(tables)
    )


@pytest.mark.parametrize(
    ("rows", "by", "note"),
    [
        (table({"a": A, "b": B}), "sequence", "sequence is not ranked: no truth has a job"),
        (
            pd.DataFrame([job("a", "1", 1.0), job("b", "01", 2.0, truth="gt/1")]),
            "tracker",
            "no sequence has a job for each value of tracker; a has sequence=1, but b does not",
        ),
        (table({"a": A}), "tracker", "tracker has only one value: nothing to rank"),
        (
            pd.concat([table({"a": A}), table({"b": A}, cutoff=20.0)], ignore_index=True),
            "tracker",
            "tracker is not ranked: only a has values with cutoff ",
        ),
        (
            failed(table({"a": A, "b": A}), range(8, 16)),
            "tracker",
            "tracker is not ranked: only a has values",
        ),
        (table({str(k): A[:1] for k in range(101)}), "tracker", "at most 100 are ranked"),
    ],
)
def test_nothing_to_rank(rows: pd.DataFrame, by: str, note: str) -> None:
    tables = tabulated(rows, [by])
    assert tables.rankings == ()
    assert note in tables.notes[0]
    assert note in batch_report(tables, "markdown")


def test_no_job_has_a_value() -> None:
    tables = tabulated(failed(table({"a": A}), range(8)), ["tracker"])
    assert words(tables) == "8 jobs, 8 failed"
    document = json.loads(batch_report(tables, "json"))
    assert (document["groups"], document["ranking"], len(document["jobs"])) == ([], [], 8)


@settings(max_examples=examples(4))
@given(st.randoms(use_true_random=False))
def test_order_and_names_of_rows_change_nothing(random: Any) -> None:
    rows = table({"a": A, "b": B, "c": C}, width=1.0)
    order = list(range(len(rows)))
    random.shuffle(order)
    names = [f"x{k}" for k in range(8)]
    random.shuffle(names)
    other = rows.iloc[order].reset_index(drop=True)
    for column in ("label.sequence", "truth"):
        other[column] = other[column].map(lambda text: names[int(text[-1])])
    first, second = (tabulated(each, ["tracker"]) for each in (rows, other))
    assert first.rankings == second.rankings
    exact = ["tracker", "jobs", "expected", "confidence_lower", "confidence_upper"]
    pd.testing.assert_frame_equal(first.groups[exact], second.groups[exact])


def test_mean_of_roots_is_taken_when_asked_for() -> None:
    rows = table({"a": [9.0, 16.0]})
    plain, asked = tabulated(rows, ["tracker"]), tabulated(rows, ["tracker"], roots=True)
    assert "mean_of_roots" not in plain.groups
    assert asked.groups["mean_of_roots"].tolist() == [3.5]
    assert "mean of roots" not in words(plain)
    assert "mean of roots: the plain mean of the values" in words(asked)
    line = next(line for line in batch_report(asked, "table").splitlines() if line[2:3] == "a")
    assert line.split()[-1] == "3.5"


def bold(tables: BatchTables) -> dict[str, list[tuple[str, list[str]]]]:
    """Of each table, by the last of its head, rows with bold cells: name, heads of these."""
    found: dict[str, list[tuple[str, list[str]]]] = {}
    for text in batch_report(tables, "latex").split(r"\toprule")[1:]:
        lines = [line.removesuffix(r"\\").split("&") for line in text.splitlines() if "&" in line]
        head, *rows = [[cell.strip() for cell in line] for line in lines]
        kept = found[head[-1]] = []
        for row in rows:
            marked = [name for name, cell in zip(head, row, strict=True) if "textbf" in cell]
            kept += [(row[0].strip("}")[-1], marked)] if marked else []
    return found


def test_best_values_are_bold_in_all_tables_in_latex() -> None:
    rows = table({"a": A, "b": A + 5})
    tables = tabulated(rows, ["tracker"])
    # Of MOTA and MOTP the highest, of all else the least.
    others = {"MOTA": [0.5, 0.6], "MOTP": [0.7, 0.6], "IDSW": [3.0, 2.0]}
    columns = {f"with.clear.{name}": values for name, values in others.items()}
    columns |= {"with.similarity.zero": [1.0, 1.0], "with.similarity.threshold": [0.5, 0.5]}
    groups = tables.groups.assign(**columns)
    assert bold(replace(tables, groups=groups)) == {
        "p": [("a", ["RMS-TGOSPA"])],
        "switch": [("a", ["TGOSPA", "total"])],
        "IDSW": [("a", ["MOTP"]), ("b", ["MOTA", "IDSW"])],
    }
    each = tabulated(rows, ["tracker", "sequence"])
    assert len(bold(each)["switch"]) == 8  # the best of each sequence


def test_nothing_is_bold_that_is_not_proven_to_be_best() -> None:
    few = failed(table({"a": A, "b": A * 2}), [0])
    assert bold(tabulated(few, ["tracker"]))["switch"] == []  # sums of other jobs
    assert bold(tabulated(few, ["tracker"]))["p"] == [("a", ["RMS-TGOSPA"])]  # the common ones
    for rows, by in (
        (table({"a": A, "b": A + 5}, width=30.0), "tracker"),
        (table({"a": A, "b": A}), "tracker"),
        (table({"a": A, "b": A + 5}), "sequence"),
    ):
        assert not any(bold(tabulated(rows, [by])).values())
    both = pd.concat([table({"a": A, "b": B}), table({"a": B, "b": A}, cutoff=9.0)])
    tables = tabulated(both.reset_index(drop=True), ["tracker"])
    assert [name for name, _ in bold(tables)["p"]] == ["a", "b"]  # one for each cutoff


def test_hostile_labels() -> None:
    names = ["a|b", "50%_$x", "=1+1", "é\x1b[31m"]
    tables = tabulated(table({name: A + k for k, name in enumerate(names)}), ["tracker"])
    texts = {name: batch_report(tables, name) for name in REPORTS if name != "methods"}
    assert r"50\%\_\$x" in texts["latex"]
    assert r"a\|b" in texts["markdown"]
    assert "'=1+1" in texts["csv"]
    assert not any("\x1b" in text for name, text in texts.items() if name != "csv")
    assert [row["name"] for row in json.loads(texts["json"])["ranking"]] == names


def test_a_label_may_be_called_like_a_column() -> None:
    rows = table({"a": A, "b": B}).rename(columns={"label.tracker": "label.jobs"})
    tables = tabulated(rows, ["jobs"])
    assert tables.groups["label.jobs"].tolist() == ["a", "b"]
    assert tables.groups["jobs"].tolist() == [8, 8]
    assert "  jobs  RMS-TGOSPA" in batch_report(tables, "table")
    assert "  jobs  jobs  RMS" in batch_report(replace(tables, columns=("jobs", "tgospa")), "table")


def test_open_jobs_are_counted() -> None:
    for status, count in (("open", 8), ("done", 0)):  # a solver may be done without a proof
        wide = table({"a": A}, width=1.0, certified=False, status=status)
        rows = pd.concat([wide, table({"b": A})]).reset_index(drop=True)
        tables = tabulated(rows, ["tracker"])
        assert tables.groups["open"].tolist() == [count, 0]
        assert ("8 jobs did not reach the requested accuracy" in words(tables)) is (count > 0)
        assert "values are between the proven bounds" in words(tables)
    assert "proven bounds" not in words(tabulated(table({"b": A}), ["tracker"]))
