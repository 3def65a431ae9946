"""Times as people have them: dates of days and months, epochs, GPS weeks, zones, two columns."""

from pathlib import Path

import pandas as pd
import pytest

from tgospa_eval import ConfigError, InputError, evaluate

UTC = ["2025-04-03T10:00:00Z", "2025-04-03T10:00:10.5Z"]
METRIC = {"cutoff": 5, "switch_penalty": 1}


def side(**columns: object) -> pd.DataFrame:
    return pd.DataFrame({"id": "002190001", "x": [0.0, 1.0], "y": 0.0, **columns})


WRITTEN = {
    "day first": (
        {"t": ["03/04/2025 12:00:00.0", "03/04/2025 12:00:10.5"]},
        {"format": "%d/%m/%Y %H:%M:%S.%f", "zone": "Europe/Copenhagen"},
    ),
    "month first": (
        {"t": ["04/03/2025 10:00:00.0", "04/03/2025 10:00:10.5"]},
        {"format": "%m/%d/%Y %H:%M:%S.%f", "zone": "UTC"},
    ),
    "with its zone": (
        {"t": ["3 Apr 2025 05:00:00.0 -0500", "3 Apr 2025 05:00:10.5 -0500"]},
        {"format": "%d %b %Y %H:%M:%S.%f %z"},
    ),
    "seconds": ({"t": [1743674400, 1743674410.5]}, {"format": "s"}),
    "milliseconds": ({"t": [1743674400000, 1743674410500]}, {"format": "ms"}),
    "nanoseconds": ({"t": [1743674400 * 10**9, 1743674410500000000]}, {"format": "ns"}),
    "guessed seconds": ({"t": [1743674400, 1743674410.5]}, {}),
    "guessed milliseconds": ({"t": [1743674400000, 1743674410500]}, {}),
    "guessed microseconds": ({"t": [1743674400 * 10**6, 1743674410500000]}, {}),
    "ISO of a zone": (
        {"t": ["2025-04-03T12:00:00", "2025-04-03 12:00:10.5"]},
        {"zone": "Europe/Copenhagen"},
    ),
    "GPS": ({"week": [2360, 2360], "tow": [381618.0, 381628.5]}, {"format": "gps"}),
    "date and time": (
        {"week": ["03-04-2025", "03-04-2025"], "tow": ["10:00:00.0", "10:00:10.5"]},
        {"format": "%d-%m-%Y %H:%M:%S.%f", "zone": "UTC"},
    ),
}


@pytest.mark.parametrize("way", ["table", "csv"])
@pytest.mark.parametrize("name", WRITTEN)
def test_times_are_those_of_utc(name: str, way: str, tmp_path: Path) -> None:
    columns, form = WRITTEN[name]
    made = side(**columns)
    options = {f"truth_time_{key}": value for key, value in form.items()}
    if "week" in columns:
        options["truth_columns"] = "t=week+tow"
    given: object = made
    if way == "csv":
        given = tmp_path / "truth.csv"
        made.to_csv(given, index=False, float_format="%.1f")
    for one, other, role in (("truth", "estimate", 0), ("estimate", "truth", 1)):
        own = {key.replace("truth", one): value for key, value in options.items()}
        pair = (given, side(t=UTC))[:: 1 - 2 * role]
        result = evaluate(*pair, **METRIC, **own)
        assert result.total == 0, (one, other)
        assert result.sizes["steps"] == 2


def test_dates_that_may_be_either_are_never_guessed() -> None:
    for text, ways in (("03/04/2025 12:00", 2), ("13/04/2025", 1), ("03.04.2025", 2)):
        with pytest.raises(InputError) as error:
            evaluate(side(t=[text, text]).head(1), side(t=UTC), **METRIC)
        assert str(error.value).count(" reads 2025-") == ways
        assert "reads 2025-04-" in str(error.value)


@pytest.mark.parametrize(
    ("times", "form", "message"),
    [
        (["2025-10-26T02:30:00"] * 2, {"zone": "Europe/Copenhagen"}, "is twice or never in"),
        (["2025-03-30T02:30:00"] * 2, {"zone": "Europe/Copenhagen"}, "is twice or never in"),
        (UTC, {"zone": "Mars"}, "there is no such zone"),
        (UTC, {"format": "fortnights"}, "must be a format such as"),
        (UTC, {"format": "%d/%m/%Y"}, "does not fit"),
        (["1", "x"], {"format": "s"}, '"x" does not fit'),
        (["2025-04-03T10:00:00", "2025-04-03T10:00:10"], {}, "says what zone the ISO times are of"),
        ([17, 18], {}, "write both as ISO times"),
    ],
)
def test_wrong_times_get_a_message(times: list[object], form: dict[str, str], message: str) -> None:
    options = {f"truth_time_{key}": value for key, value in form.items()}
    made = side(t=times)
    made["id"] = ["a", "b"]
    with pytest.raises((ConfigError, InputError), match=message):
        evaluate(made, side(t=UTC), **METRIC, **options)


def test_leap_seconds_of_gps() -> None:
    """At the end of 2016 UTC fell one more second behind; in 1980 there was none."""
    for week, second, text in (
        (0, 0, "1980-01-06T00:00:00Z"),
        (1930, 16, "2016-12-31T23:59:59Z"),
        (1930, 18, "2017-01-01T00:00:00Z"),
    ):
        made = pd.DataFrame({"id": 1, "week": [week], "tow": [second], "x": 0.0})
        other = pd.DataFrame({"id": 1, "t": [text], "x": 0.0})
        options = {"truth_columns": "t=week+tow", "truth_time_format": "gps"}
        assert evaluate(made, other, **METRIC, **options).total == 0, text
