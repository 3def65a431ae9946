"""Arrays of xarray: read by the names of their dimensions, also without xarray (a stand-in)."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tgospa_eval import ConfigError, InputError, Trajectories, compare, evaluate

GIVEN: dict[str, Any] = {"cutoff": 10.0, "switch_penalty": 5.0}


class Array:
    """What is used of a DataArray."""

    def __init__(self, values: Any, dims: tuple[str, ...], coords: Mapping[str, Any]) -> None:
        self.values, self.dims = np.asarray(values), dims
        self.coords = {k: SimpleNamespace(values=np.asarray(v)) for k, v in coords.items()}
        self.sizes = dict(zip(dims, self.values.shape, strict=True))

    def isel(self, at: dict[str, int]) -> "Array":
        ((dim, k),) = at.items()
        rest = tuple(name for name in self.dims if name != dim)
        coords = {name: one.values for name, one in self.coords.items() if name in rest}
        return Array(np.take(self.values, k, self.dims.index(dim)), rest, coords)


class Dataset:
    """What is used of a Dataset."""

    isel = None

    def __init__(self, variables: dict[str, Any], coords: dict[str, Any]) -> None:
        self.data_vars = {
            name: Array(values, dims, {}) for name, (dims, values) in variables.items()
        }
        self.dims = list(dict.fromkeys(d for one in self.data_vars.values() for d in one.dims))
        self.coords = {k: SimpleNamespace(values=np.asarray(v)) for k, v in coords.items()}


@pytest.fixture(params=["stand-in", "xarray"])
def made(request: pytest.FixtureRequest) -> Any:
    """Constructors of an array and of a set of arrays."""
    if request.param == "stand-in":
        return SimpleNamespace(array=Array, dataset=Dataset)
    xarray = pytest.importorskip("xarray")
    return SimpleNamespace(
        array=lambda values, dims, coords: xarray.DataArray(values, dims=dims, coords=coords),
        dataset=lambda variables, coords: xarray.Dataset(variables, coords=coords),
    )


def test_units_in_attributes() -> None:
    truth, estimate = (Array(a, ("time", "object", "state"), {}) for a in scene())
    for side, unit in ((truth, "m"), (estimate, "km")):
        side.attrs = {"units": unit}  # type: ignore[attr-defined]
    with pytest.raises(ConfigError, match='use estimate_scale="x=1000,y=1000"'):
        evaluate(truth, estimate, **GIVEN)
    evaluate(truth, estimate, **GIVEN, estimate_scale="x=1000,y=1000")


def scene() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    truth = np.cumsum(rng.normal(size=(5, 2, 2)), axis=0)
    estimate = truth + rng.normal(size=truth.shape)
    estimate[2, 1] = np.nan
    return truth, estimate


def test_an_array_by_its_dimensions(made: Any) -> None:
    truth, estimate = scene()
    total = evaluate(truth, estimate, **GIVEN).total
    coords = {"time": np.arange(5) / 2, "object": ["a", "b"], "state": ["x", "y"]}
    given = made.array(estimate.transpose(2, 1, 0), ("state", "object", "time"), coords)
    result = evaluate((coords["time"], truth), given, **GIVEN)
    assert result.total == pytest.approx(total, rel=1e-12)
    assert set(result.per_estimate["id"]) == {"a", "b"}
    plain = made.array(estimate, ("frames", "track_id"[:5], "coords"), {})
    assert evaluate(truth, plain, **GIVEN).total == pytest.approx(total, rel=1e-12)
    moving = np.concatenate([estimate, np.ones_like(estimate)], axis=2)
    four = made.array(moving, ("t", "target", "component"), {})
    chosen = evaluate(truth, four, mapping=((0, 1), (0, 1)), **GIVEN)
    assert chosen.total == pytest.approx(total, rel=1e-12)
    one = made.array(estimate[:, 0], ("time", "state"), {})
    assert evaluate(truth, one, **GIVEN).total == pytest.approx(
        evaluate(truth, estimate[:, :1], **GIVEN).total
    )
    stamps = np.datetime64("2026-01-01") + np.arange(5) * np.timedelta64(500, "ms")
    dated = made.array(estimate, ("time", "id", "xy"), {"time": stamps})
    assert evaluate((stamps, truth), dated, **GIVEN).total == pytest.approx(total, rel=1e-12)


def test_a_dataset_of_coordinates_or_states(made: Any) -> None:
    truth, estimate = scene()
    both = ("time", "object")
    columns = {"x": (both, estimate[..., 0]), "y": (both, estimate[..., 1])}
    more = columns | {"score": (both, np.ones(estimate.shape[:2])), "noise": (("time",), range(5))}
    total = evaluate(truth, estimate, **GIVEN).total
    for variables in (columns, more):
        found = evaluate(
            (np.arange(5), truth), made.dataset(variables, {"time": range(5)}), **GIVEN
        )
        assert found.total == pytest.approx(total, rel=1e-12)
    spread = np.broadcast_to(2 * np.eye(2), (*estimate.shape, 2))
    gaussian = made.dataset(
        {
            "P": ((*both, "state", "state2"), spread),
            "position": ((*both, "state"), estimate),
        },
        {},
    )
    own = GIVEN | {"distance": "gaussian-wasserstein"}
    expected = evaluate(truth, Trajectories.from_array(estimate, covariance=spread), **own)
    assert evaluate(truth, gaussian, **own).total == pytest.approx(expected.total, rel=1e-12)
    points = truth[:, :, None] + np.random.default_rng(0).normal(size=(5, 2, 4, 2))
    clouds = {k: ((*both, "particle"), points[..., j]) for j, k in enumerate(("x", "y"))}
    of_clouds = GIVEN | {"distance": "cloud-wasserstein"}
    assert evaluate(truth, made.dataset(clouds, {}), **of_clouds).total == pytest.approx(
        evaluate(truth, {"particles": points}, **of_clouds).total
    )


def test_runs_are_a_dimension(made: Any) -> None:
    truth, estimate = scene()
    runs = np.stack([estimate, estimate + 1])
    given = made.array(runs, ("run", "time", "object", "state"), {})
    found = compare(truth, {"a": given, "b": list(runs[::-1])}, **GIVEN)
    assert found.document["runs"] == 2
    assert found.table()["total"][0] == pytest.approx(found.table()["total"][1])
    with pytest.raises(
        InputError, match=r"^estimate: dimensions run, .*: only compare and batch accept"
    ):
        evaluate(truth, given, **GIVEN)


def test_dimensions_without_meaning(made: Any) -> None:
    truth, estimate = scene()
    odd = made.array(estimate, ("time", "object", "colour"), {})
    with pytest.raises(
        InputError, match=r'^estimate: unknown dimension "colour"; known names are run,'
    ):
        evaluate(truth, odd, **GIVEN)
    twice = dict.fromkeys(("position", "velocity"), (("time", "object", "state"), estimate))
    with pytest.raises(InputError, match=r"^estimate: velocity and another variable have the same"):
        evaluate(truth, made.dataset(twice, {}), **GIVEN)
    still = made.array(estimate[0], ("object", "state"), {})
    with pytest.raises(InputError, match=r"^estimate: dimensions object, state: no time$"):
        evaluate(truth, still, **GIVEN)
