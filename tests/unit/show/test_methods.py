"""The paragraph for a paper, and what is cited."""

import re
from collections.abc import Callable
from typing import Any

import pandas as pd
import pytest
import yaml
from checkout import ROOT, SAMPLES

from tgospa_eval import __version__, evaluate, simulate
from tgospa_eval.show.methods import MEMBERS, METRIC, TOOL, methods

SIDES = [SAMPLES / "quickstart" / f"{name}.csv" for name in ("truth", "estimate")]


def test_a_paragraph_says_what_was_computed() -> None:
    text = methods(evaluate(*SIDES, 10.0, 2, 5.0, unit="m"))
    for part in (
        f"[@{METRIC}], with c = 10 m, p = 2, gamma = 5 m, and the euclidean distance",
        "the 56 steps at which either side has a state, t = 3 to 58",
        "5 objects (195 states) and 7 estimated trajectories. TGOSPA = 42.5352 m (exact: ",
        "TGOSPA = 42.5352 m (exact: proven lower and upper bound agree to 12 digits)",
        "localisation 284.24, missed 1,050, false 400, switch 75",
        f"tgospa-eval {__version__} [@{TOOL}], solver certified",
    ):
        assert part in text
    assert text.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "part"),
    [
        ({"rho": 0.3}, "for false targets [@garciafernandez2025quasi]"),
        ({"rho": 0.3}, "rho = 0.3, and"),
        ({"step_weights": dict.fromkeys(range(60), 2.0)}, "[@garciafernandez2021timeweighted]"),
        ({"grid": "truth"}, "steps of the ground truth, t"),
        ({"steps": "0:9"}, "10 steps of a chosen clock, t = "),
        ({"distance": "manhattan"}, "the manhattan distance of the states (x, y)"),
        ({"interpolate": "estimate", "max_gap": 3}, "the 56 steps of the ground truth, t = 3"),
        ({"interpolate": "truth", "max_gap": 3}, ". The ground truth was interpolated linearly"),
        ({"grid": "common"}, "states and of the ground truth in outages of the estimate, t = "),
        ({"grid": "common", "outage": "none"}, "states, t = "),
        ({"grid": "common", "outage": "none"}, ". Outages of the estimate do not count."),
        ({"grid": "common", "outage": "none"}, ", with the reason: 4 (grid)"),
        ({"resample": 1, "max_gap": 3}, "each report of the estimate is valid for 1 and was"),
        ({"time_tolerance": 0.2}, ". Times at most 0.2 apart are one step."),
        ({"time_offset": 1}, ". 1 was added to the times of the estimate."),
        ({"time": "10:20", "region": "x=0:50"}, "in 10:20 were read; only states in x=0:50"),
        ({"scale": "x=2"}, ". Scale = x 2, y 1."),
    ],
)
def test_what_was_chosen_is_said(options: dict[str, Any], part: str) -> None:
    assert part in methods(evaluate(*SIDES, 10.0, 2, 5.0, **options))


def test_a_bracket_is_said_as_one() -> None:
    truth, estimate = simulate(targets=12, steps=30, seed=3, area=60.0, noise=3.0)
    result = evaluate(truth, estimate, 10.0, 2, 5.0, solver="sinkhorn", epsilon=0.9, gap=0.5)
    assert not result.certified
    assert f"TGOSPA is between {result.lower_bound:.6g} and " in methods(result)


def test_probabilities_of_existence_are_cited() -> None:
    table = pd.DataFrame({"id": ["a"], "t": [0], "x": [0.0], "y": [0.0], "existence": [0.5]})
    assert "[@xia2025probabilistic]" in methods(evaluate(table, table, 5.0, existence="use"))


def test_every_key_is_in_the_page_and_nobody_is_invented() -> None:
    page = (ROOT / "docs" / "reference" / "cite.md").read_text(encoding="utf-8")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for key in (METRIC, TOOL, *(key for _, key in MEMBERS.values())):
        assert re.search(rf"^@\w+{{{key},$", page, re.M)
    assert "](CITATION.cff)" in readme
    assert f"{{{METRIC}," in readme
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["authors"] == [{"name": "tgospa-eval contributors"}]
    assert citation["version"] == __version__
    assert f"version = {{{__version__}}}" in page


def test_on_the_command_line(invoke: Callable[..., Any]) -> None:
    done = invoke(*map(str, SIDES), "-c", "10", "-g", "5", "--format", "methods", "-q")
    assert done.out == methods(evaluate(*SIDES, 10.0, 2, 5.0))
    done = invoke(*map(str, SIDES), "--sweep", "gamma=1,2", "--format", "methods")
    assert "--format methods is not supported with --sweep" in done.err
    assert invoke("batch", "x.csv", "--format", "methods").status == 2
