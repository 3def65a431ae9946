"""Shades, numbers and axes of the page of a batch."""

import itertools

import pandas as pd
import pytest

from tgospa_eval.results.records import Json, Time
from tgospa_eval.show.batch import MAX_SQUARES, RmsCurve, heat_of, on_one_axis
from tgospa_eval.show.style import DARK, HEAT_LEVELS, LIGHT, heat_shades
from tgospa_eval.show.table_text import first_names, order_in_words


def luminance(colour: str) -> float:
    """As WCAG has it."""
    shares = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    red, green, blue = (x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in shares)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


@pytest.mark.parametrize("colours", [LIGHT, DARK], ids=["light", "dark"])
def test_letters_are_legible_on_every_shade(colours: dict[str, str]) -> None:
    shades = heat_shades(colours)
    assert shades[0] == colours["paper"]
    assert len(set(shades)) == HEAT_LEVELS
    ink = luminance(colours["ink"])
    for shade in shades:
        low, high = sorted((ink, luminance(shade)))
        assert (high + 0.05) / (low + 0.05) >= 4.5, shade


def rows(values: dict[tuple[str, str], float | None], width: float = 0.0) -> pd.DataFrame:
    """A job of one step for each row and column; its cost, or None if it failed."""
    return pd.DataFrame(
        [
            {
                "label.down": down,
                "label.across": across,
                "status": "failed" if value is None else "done",
                "total_lower": None if value is None else value - width,
                "total_upper": value,
                "order": None if value is None else 2.0,
                "judged.steps": None if value is None else 1,
            }
            for (down, across), value in values.items()
        ]
    ).astype({"total_lower": float, "total_upper": float, "judged.steps": float, "order": float})


def heat(values: dict[tuple[str, str], float | None], width: float = 0.0) -> Json:
    return heat_of(
        rows(values, width), ("down", "across"), ["a", "b"], lambda row: str(row["label.down"])
    )


def test_of_many_rows_those_that_lose_most_are_shown() -> None:
    values: dict[tuple[str, str], float | None] = {
        (f"{k}", "a"): float(k) for k in range(MAX_SQUARES + 200)
    }
    values["7", "a"] = None
    made = heat(values)
    assert made["squares"]
    assert (len(made["rows"]), made["hidden_rows"]) == (MAX_SQUARES, 200)
    assert made["rows"][0] == "7"  # it failed
    assert made["rows"][1] == "201"
    assert made["ends"] is not None
    assert made["ends"][0] == pytest.approx(201**0.5)


def curve(times: list[Time], rms: list[float], group: str = "a") -> RmsCurve:
    band = [0.0] * len(rms), [2 * value for value in rms]
    return RmsCurve(
        group={"who": group},
        kind="step",
        times=times,
        runs=6,
        rms={"total": rms, "missed": rms},
        bands={"total": band, "missed": band},
        bounds=None,
        band="bootstrap",
    )


def test_curves_of_other_times_share_an_axis() -> None:
    both = [curve([0, 8], [1.0, 2.0]), curve([2, 4.0], [1.0, 2.0], "b")]
    _, places, ends = on_one_axis(both)
    assert [at.tolist() for at in places] == [[0, 8], [2, 4]]
    assert ends == (0, 8)
    # Times of several kinds are steps.
    _, places, _ = on_one_axis([curve(["2026-01-01T00:00:00"], [1.0]), curve([2, 3], [1.0, 2.0])])
    assert [at.tolist() for at in places] == [[1], [1, 2]]


def test_sentences_name_few_of_many() -> None:
    names = [f"n{k}" for k in range(100)]

    def order(places: list[tuple[int, int]], verdict: str) -> str:
        entries = [{"name": n, "place": place} for n, place in zip(names, places, strict=True)]
        pairs = itertools.combinations(names, 2)
        made = [{"first": a, "second": b, "verdict": verdict} for a, b in pairs]
        return order_in_words("combined", entries, made)

    sentence = order([(k, k) for k in range(1, 101)], "less")
    first = "n0, n1, n2, n3, n4, n5, n6, n7 and 92 more, all in the table"
    assert sentence == f"Proven order of these files by combined, best first: {first}"
    sentence = order([(1, 1)] * 100, "equal")
    assert (
        sentence == f"Proven to be equal on these files by combined: {first.replace(',', ' =', 7)}"
    )
    tied = order([(1, 100)] * 100, "open")
    assert tied == f"None is proven best by combined: it may be any of {first}"
    assert first_names([names[:2], names[2:8]]) == "n0 = n1, n2 = n3 = n4 = n5 = n6 = n7"
