"""Places and units as people have them."""

import numpy as np
import pandas as pd
import pytest

from tgospa_eval import ConfigError, evaluate

FLIGHT = pd.DataFrame({"id": 1, "t": [0, 1], "lat": 55.0, "lon": 12.0, "alt": [3000.0, 3048.0]})
FEET = FLIGHT.assign(alt=[10000.0, 10000.0])
EARTH = {"distance": "geodesic", "columns": "lat,lon,alt", "cutoff": 500, "switch_penalty": 100}


def test_heights_in_feet_have_a_factor_of_their_own() -> None:
    result = evaluate(FLIGHT, FEET, **EARTH, estimate_scale="alt=0.3048")
    assert result.total == pytest.approx(48.0**2)
    assert result.parameters["estimate_scale"] == {"alt": 0.3048}
    assert evaluate(FEET, FLIGHT, **EARTH, truth_scale="alt=0.3048").total == result.total
    heavier = evaluate(FLIGHT, FEET, **EARTH, estimate_scale="alt=0.3048", vertical_weight=2)
    assert heavier.total == pytest.approx(4 * 48.0**2)


def test_scales_of_columns_are_those_of_arrays_and_covariances() -> None:
    truth = np.zeros((3, 1, 2))
    options = {"cutoff": 5, "switch_penalty": 1}
    found = evaluate(truth, truth + np.array([0.001, 1]), **options, estimate_scale=("x=1000",))
    assert found.total == pytest.approx(3 * 2)
    spread = pd.DataFrame({"id": 1, "t": [0], "x": 0.0, "cov_xx": 1.0})
    wide = {"distance": "gaussian-wasserstein", **options, "estimate_scale": "x=3"}
    assert evaluate(spread, spread, **wide).total == pytest.approx(4.0)  # (3 - 1)^2 of deviations


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"estimate_scale": "z=2"}, '"z" is none of the state columns x,y'),
        ({"truth_scale": "x=0"}, "must be name=number, with a number > 0"),
        ({"truth_scale": "x=1,x=2"}, '"x" is given twice'),
    ],
)
def test_wrong_scales_get_a_message(options: dict[str, str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        evaluate(np.zeros((3, 1, 2)), np.zeros((3, 1, 2)), cutoff=5, switch_penalty=1, **options)
