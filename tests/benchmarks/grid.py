"""The grid: many methods on the same instances, taking turns, their values compared."""

import time
from collections.abc import Callable, Container, Sequence
from dataclasses import asdict
from functools import cache

from methods import Instance, Reading
from scenes import Scene
from store import Store

PART = "grid"
SETTINGS = (
    Scene(10, 50, 20.0),
    Scene(20, 100, 20.0),
    Scene(50, 100, 20.0),
    Scene(50, 100, 100.0),
    Scene(100, 100, 300.0),
    Scene(200, 200, 300.0),
    Scene(50, 100, 20.0, noise=2.0),
    Scene(100, 100, 20.0, noise=2.0),
)

ROUNDS = 7
QUICK = 1.0
"""Seconds within which a method is run again, for its best."""

SLOW = 10.0
"""Seconds above which a method, or all of a setting, is measured on the first seed only."""

AGREEMENT = 1e-6
"""Relative difference of two totals that is still the same value."""


class DisagreementError(Exception):
    """Two methods gave different values for one instance."""


def measure(
    scenes: Sequence[Scene],
    seeds: int,
    store: Store,
    deadline: float,
    say: Callable[[str], None],
    methods: Container[str] | None = None,
) -> None:
    """Measure what is missing: the first seed of every setting, then the second of every setting.

    No seed but the first is begun after `deadline` (of `time.monotonic`).
    """
    for seed in range(seeds):
        for scene in scenes:
            first = stored(scene, 0, "certified", store)
            if seed and first is not None and first.seconds > SLOW:
                continue
            if seed and time.monotonic() > deadline:
                say("the time is used up: no further seeds")
                return
            _measure_instance(scene, seed, store, say, methods)


def stored(scene: Scene, seed: int, method: str, store: Store) -> Reading | None:
    """What was measured before."""
    values = store.get(PART, str(scene), str(seed), method)
    return None if values is None else Reading(**values)


def _measure_instance(
    scene: Scene,
    seed: int,
    store: Store,
    say: Callable[[str], None],
    methods: Container[str] | None,
) -> None:
    spent: dict[str, float] = {}
    instance = Instance(scene, seed)
    readings, missing = _readings(instance, scene, seed, store)
    missing = [method for method in missing if methods is None or method in methods]
    if missing:
        _warm_up()
    for turn in range(ROUNDS):
        for method in missing:
            if turn and spent[method] > QUICK:
                continue
            if not turn:
                say(f"{scene} seed {seed}: {method}")
            reading = instance.methods[method]()
            spent[method] = spent.get(method, 0.0) + reading.seconds
            if not turn or reading.seconds < readings[method].seconds:
                readings[method] = reading
            if reading.seconds > QUICK and not turn:
                _keep(scene, seed, method, reading, store)
    _compare(f"{scene} seed {seed}", readings)
    for method in missing:
        if readings[method].seconds <= QUICK:
            _keep(scene, seed, method, readings[method], store)


def _readings(
    instance: Instance, scene: Scene, seed: int, store: Store
) -> tuple[dict[str, Reading], list[str]]:
    """What is stored, and the methods that are to be measured."""
    readings: dict[str, Reading] = {}
    missing = []
    for method in instance.methods:
        reading = stored(scene, seed, method, store)
        first = stored(scene, 0, method, store)
        if reading is not None:
            readings[method] = reading
        elif (first is None or first.seconds <= SLOW) and instance.offers(method):
            missing.append(method)
    return readings, missing


@cache
def _warm_up() -> None:
    """Import, and compile, whatever is imported and compiled at first use."""
    for run in Instance(Scene(5, 10, 10.0), 0).methods.values():
        run()


def _keep(scene: Scene, seed: int, method: str, reading: Reading, store: Store) -> None:
    store.add(PART, str(scene), str(seed), method, values=asdict(reading))


def _compare(name: str, readings: dict[str, Reading]) -> None:
    """All brackets of an instance must have a value in common, up to `AGREEMENT`."""
    if not readings["certified"].complete:
        raise DisagreementError(f"{name}: the default solver did not prove its value")
    highest = max(readings, key=lambda method: readings[method].lower)
    lowest = min(readings, key=lambda method: readings[method].upper)
    lower, upper = readings[highest].lower, readings[lowest].upper
    if lower > upper * (1 + AGREEMENT):
        raise DisagreementError(
            f"{name}: {highest} says {lower:.12g} or more, {lowest} says {upper:.12g} or less"
        )
