"""Random scenes with random options, of every kind that says which states count and how much."""

import io
import warnings
from typing import Any

import numpy as np
import pandas as pd

from tgospa_eval import ConfigError, Result, TgospaWarning, evaluate
from tgospa_eval.errors import NothingLeftError

STAMPS = np.arange(-40, 80) / 4
"""All stamps that a scene, or a repair of it, may have."""

NOTHING = (
    "no step is left",
    "no multiple of it",
    "no row is left",
    "weights of steps are 0",
    "no row of either",
)
"""What is said where nothing is left to evaluate."""


class AnyOptions:
    """Two small tables, and options that fit them.

    Parameters
    ----------
    seed : int
        Of everything.

    Attributes
    ----------
    truth, estimate : DataFrame
        ``id, t, x, y`` with marks, probabilities, and attributes of every kind, some blank.
    options : dict
        Keywords of `evaluate`.
    """

    def __init__(self, seed: int) -> None:
        rng = self.rng = np.random.default_rng(seed)
        self.steps = int(rng.integers(2, 10))
        truth = self._walks("a", int(rng.integers(0 if rng.random() < 0.1 else 1, 4)))
        self.truth = self._with_holes(truth)
        self.estimate = self._with_holes(self._tracked(truth))
        self.options: dict[str, Any] = {
            "cutoff": float(rng.choice([1, 2, 3.5])),
            "order": float(rng.choice([1, 2])),
            "switch_penalty": float(rng.choice([0, 0.5, 1])),
            "columns": "x,y",
        }
        self._steps_that_count()
        if rng.random() < 0.6:
            self._not_judged()
        elif rng.random() < 0.4:
            self.options["existence"] = "use"
        elif rng.random() < 0.5:
            self.options["rho"] = 0.3
        if rng.random() < 0.25:
            weight = rng.choice([0.0, 0.5, 1.0, 3.0], len(STAMPS))
            table = {"t": STAMPS, "weight": weight, "switch_weight": rng.permutation(weight)}
            self.options["step_weights"] = pd.DataFrame(table)
        if rng.random() < 0.2:
            self.options["window"] = "3"
        if rng.random() < 0.2:
            self.options["distance"] = str(rng.choice(["manhattan", "chebyshev"]))
        elif rng.random() < 0.15:
            self.options["distance"] = "gaussian-wasserstein"
            for side in (self.truth, self.estimate):
                side["std_x"], side["std_y"] = rng.choice([0.0, 0.5, 1.0], (2, len(side)))
        self._how_they_are_read()

    def _walks(self, letter: str, count: int) -> pd.DataFrame:
        """Straight walks on a grid of tenths, at whole stamps."""
        t = np.arange(self.steps)
        walks = []
        for k in range(count):
            begin, speed = self.rng.uniform(0, 4, 2), self.rng.uniform(-1, 1, 2)
            x, y = np.round(begin[:, None] + speed[:, None] * t, 1)
            walks.append(pd.DataFrame({"id": f"{letter}{k}", "t": t, "x": x, "y": y}))
        none = pd.DataFrame({"id": [], "t": [], "x": [], "y": []}, dtype=float)
        return pd.concat(walks) if walks else none.astype({"id": object})

    def _tracked(self, truth: pd.DataFrame) -> pd.DataFrame:
        """Tracks with noise, changed ids, false tracks, and perhaps another clock."""
        rng, found = self.rng, truth.copy()
        found["id"] = found.id.str.replace("a", "b")
        if len(found):
            change = (found.t >= rng.integers(1, 10)) & (rng.random() < 0.6)
            if rng.random() < 0.5:
                found.loc[change & (found.id == "b0"), "id"] = "b7"
            else:
                names = {"b0": "b1", "b1": "b0"}
                found.loc[change, "id"] = found.id[change].replace(names)
        found[["x", "y"]] += np.round(rng.normal(0, rng.choice([0.1, 0.6]), (len(found), 2)), 1)
        found[["x", "y"]] += rng.choice([0, 0, 0.7])
        found = pd.concat([found, self._walks("c", int(rng.integers(0, 2)))])
        found["t"] = found.t + float(rng.choice([0, 0, 0, 0.5, 1]))
        return found

    def _with_holes(self, table: pd.DataFrame) -> pd.DataFrame:
        """Some of the rows, with columns beside the states."""
        rng = self.rng
        kept = rng.random(len(table)) >= rng.choice([0.0, 0.2, 0.5])
        if rng.random() < 0.3:  # steps at which there is nothing
            kept &= ~np.isin(table.t, rng.choice(STAMPS[40:80], 8))
        table = table[kept].copy()
        rows, blank = len(table), rng.random((3, int(kept.sum()))) < 0.3
        mark = rng.choice([0.0, 0.4, 1.0])
        return table.assign(
            ignored=(rng.random(rows) < mark).astype(int),
            excused=(rng.random(rows) < mark).astype(int),
            existence=rng.choice([0.0, 0.25, 0.5, 1.0], rows),
            level=np.where(blank[0], np.nan, rng.integers(0, 3, rows)),
            share=np.where(blank[1], np.nan, np.round(rng.random(rows), 1)),
            kind=np.where(blank[2], "", rng.choice(["p", "q", "r"], rows)),
        )

    def _steps_that_count(self) -> None:
        rng, options = self.rng, self.options
        match rng.choice(["none", "grid", "interpolate", "resample", "steps"]):
            case "grid":
                options["grid"] = str(rng.choice(["truth", "estimate", "common", "union"]))
                options["time_tolerance"] = float(rng.choice([0, 0.5]))
            case "interpolate":
                options["interpolate"] = str(rng.choice(["truth", "truth", "estimate"]))
                options["max_gap"] = float(rng.choice([1, 2, 5, 20]))
                outage = rng.choice(["none", "", "2"])
                if options["interpolate"] == "truth" and outage:
                    options["outage"] = str(outage)
            case "resample":
                options["resample"] = float(rng.choice([0.5, 1]))
                options["max_gap"] = float(rng.choice([1, 2, 5]))
                options["period"] = float(rng.choice([1, 2]))
            case "steps":
                options["steps"] = str(rng.choice(["0:6", "0:8:2"]))

    def _how_they_are_read(self) -> None:
        """Filters, and another clock and unit of the estimate."""
        rng, options = self.rng, self.options
        if rng.random() < 0.1:
            options["time"] = "1:6"
        if rng.random() < 0.1:
            options["region"] = str(rng.choice(["x=0:3", "circle=2,2,2"]))
        if rng.random() < 0.1:
            options["truth_class"], self.truth = "p", self.truth.assign(**{"class": "p"})
        if rng.random() < 0.15:
            options |= {"time_scale": 0.001, "time_offset": -0.25}
            self.estimate["t"] = self.estimate.t * 1000 + 250
        if rng.random() < 0.15:
            scale = rng.choice(["unit_scale", "estimate_scale"])
            options |= {scale: 0.1 if scale == "unit_scale" else ("x=0.1", "y=0.1")}
            names = [name for name in ("x", "y", "std_x", "std_y") if name in self.estimate]
            self.estimate[names] *= 10

    def _not_judged(self) -> None:
        rng, options = self.rng, self.options
        made = options.get("interpolate") == "truth" or "resample" in options
        offered = ("marked", "marked-estimates", "level>0", "kind=p,q")
        rules = [rule for rule in offered if rng.random() < 0.4]
        if rng.random() < 0.3:
            rules.append("truth-gaps" if made else "outside-truth-steps")
        if "truth-gaps" in rules and rng.random() < 0.5:
            options["max_speed"] = 0.5
        if rules:
            options["ignore"] = tuple(rules)
        if rng.random() < 0.4 or not rules:
            left, top = rng.uniform(-1, 4, (2, 2)).round(1)
            regions = {"left": left, "top": top, "width": 1.5, "height": 2.0}
            options["ignore_regions"] = pd.DataFrame(regions)

    @staticmethod
    def read(text: str) -> pd.DataFrame:
        """The table of a CSV file."""
        texts = {"id": str, "kind": str}
        return pd.read_csv(io.StringIO(text), dtype=texts).fillna({"kind": ""})

    def evaluate(self, estimate: pd.DataFrame | None = None, **more: Any) -> Result | None:
        """The result, of another estimate perhaps; None where options leave nothing to evaluate."""
        estimate = self.estimate if estimate is None else estimate
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TgospaWarning)
            try:
                return evaluate(self.truth, estimate, **self.options, **more)
            except NothingLeftError:
                return None
            except ConfigError as error:
                if not any(words in str(error) for words in NOTHING):
                    raise
        return None
