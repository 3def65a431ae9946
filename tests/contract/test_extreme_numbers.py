"""The ends of the doubles: an answer or a sentence, and no warning of a library."""

import json
from collections.abc import Callable

import numpy as np
import pytest

from tgospa_eval import ConfigError, InputError
from tgospa_eval.distances import cloud_wasserstein
from tgospa_eval.tracks.clouds import Clouds

LAST = "1.7976931348623157e308"
CLOUD = "id,t,weight,x,y\na,0,1,{0},0\na,0,1,0,1\na,0,1,1,0\na,0,1,1,1\n"
LAW = "id,t,x,y,cov_xx,cov_xy,cov_yy\n"
STD = "id,t,x,y,std_x,std_y,rho_xy\n"


def test_steps_at_the_last_doubles_are_joined(write: Callable, invoke: Callable) -> None:
    truth = write("t.csv", f"id,t,x\na,-{LAST},0\na,0,0\na,1e308,0\na,{LAST},0\n")
    estimate = write("e.csv", f"id,t,x\nb,-{LAST},1\nb,0.25,1\nb,1e308,1\nb,{LAST},1\n")
    answer = invoke(
        truth, estimate, "-c", "5", "-g", "1", "--time-tolerance", "0.5", "--format", "json"
    )
    assert json.loads(answer.out)["total"] == pytest.approx(4, rel=1e-9)


def test_far_states_are_evaluated(write: Callable, invoke: Callable) -> None:
    """Warnings try other units, which no double may hold."""
    rng = np.random.default_rng(0)
    sides = []
    for name in ("t.csv", "e.csv"):
        state = rng.uniform(0, 1e307, (8, 20, 2))
        rows = [f"{k},{t},{x},{y}" for k in range(8) for t, (x, y) in enumerate(state[k].tolist())]
        sides.append(write(name, "\n".join(("id,t,x,y", *rows))))
    answer = invoke(*sides, "-c", "10", "-g", "1", "--format", "json")
    assert answer.status == 0
    assert json.loads(answer.out)["total"] == pytest.approx(16 * 20 * 50)


@pytest.mark.parametrize("verb", ["reduce", "associate", "inspect", "evaluate"])
def test_far_particles_are_refused_with_their_line(
    write: Callable, invoke: Callable, verb: str
) -> None:
    path = write("c.csv", CLOUD.format("1e308"))
    more = {"reduce": ("o.csv", "-n", "2"), "associate": (path, "-c", "5")}.get(verb, (path,))
    distance = () if verb == "reduce" else ("--distance", "cloud-wasserstein")
    answer = invoke(verb, path, *more, *distance)
    assert answer.status == 3
    assert answer.err.endswith(
        'line 2: a particle of id "a", t 0 is beyond 1e+150; use another unit\n'
    )
    assert invoke("reduce", write("d.csv", CLOUD.format("1e150")), "p.csv", "-n", "2").status == 0


@pytest.mark.parametrize(
    "rows",
    [
        LAW + "a,0,0,0,5e-324,0,1e12\na,1,0,0,1e-320,0,1e150\n",
        STD + "a,0,0,0,1e75,1e75,1e308\n",
        LAW + "a,0,1e308,-1e308,1e150,0,1e150\n",
    ],
)
def test_laws(write: Callable, invoke: Callable, rows: str) -> None:
    path = write("l.csv", rows)
    options = ("--distance", "gaussian-wasserstein", "--fix-cov")
    assert invoke(path, path, *options, "-c", "5").status in (0, 3)


def test_a_folder_of_coordinates_at_both_ends(write: Callable, invoke: Callable) -> None:
    path = write("t.csv", f"id,t,x,y\na,0,{LAST},0\na,1,-{LAST},1\n")
    assert invoke(path, path, "-o", "out", "--pictures", "png").status == 0


def test_whitened_particles_and_correlations_beyond_one() -> None:
    points = np.array([[0.0, 0.0], [1e150, 0.0], [1.0, 2.0]])
    with pytest.raises(ConfigError, match="standard deviations apart"):
        cloud_wasserstein(points, None, points + 1, None, covariance=1e-200 * np.eye(2))
    with pytest.raises(ConfigError, match="not positive definite"):
        cloud_wasserstein(points, None, points, None, covariance=[[1e-160, 1e200], [1e200, 1e-160]])
    with pytest.raises(InputError, match="beyond 1e\\+150"):
        Clouds(points=10 * points, weights=np.full(3, 1 / 3), first=np.array([0, 3]))
