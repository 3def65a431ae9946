"""``python tests/benchmarks``: measure what is missing, print the tables.

Interrupt it at will: what was measured stays, as long as sources, versions and machine stay.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from types import ModuleType

import batch
import click
import curve
import exactness
import gaussian
import grid
import growth
import kernel
import limits
import memory
import page
import partitioned
import report
import scale
import startup
from methods import Instance
from scenes import Scene
from store import Store, Values
from tables import Table

BUDGET = 660.0
SEEDS = 5
SMALL_SEEDS = 1
SMALL_SCENES = 10
SMALL_SETTINGS = grid.SETTINGS[:1]


@dataclass(frozen=True)
class Plan:
    """What to measure, and until when."""

    settings: tuple[Scene, ...]
    seeds: int
    growth: dict[str, tuple[Scene, ...]]
    picture: Path | None
    small: bool
    exactness: exactness.Plan
    deadline: float


def say(message: str) -> None:
    """Progress."""
    click.echo(message, err=True)


def missing(store: Store, measure: Callable[[], Values], *key: str) -> None:
    """Measure and keep, unless it is there."""
    if store.get(*key) is None:
        say(" ".join(key))
        store.add(*key, values=measure())


def run_grid(plan: Plan, store: Store) -> list[Table]:
    """Methods side by side."""
    grid.measure(plan.settings, plan.seeds, store, plan.deadline, say)
    return report.of_grid(plan.settings, plan.seeds, store)


def run_growth(plan: Plan, store: Store) -> list[Table]:
    """Time over targets and steps."""
    growth.run(plan.growth, store, plan.deadline, say)
    if plan.picture is not None:
        growth.picture(plan.growth, store, plan.picture)
    return report.of_growth(plan.growth, store)


def run_startup(plan: Plan, store: Store) -> list[Table]:
    """Start-up of the command."""
    missing(store, startup.measure, startup.PART)
    return report.of_startup(store)


def run_exactness(plan: Plan, store: Store) -> list[Table]:
    """Scenes with far cutoffs, judged by integers."""
    exactness.measure(plan.exactness, store, say)
    return report.of_exactness(plan.exactness, store)


OF_CASES: dict[ModuleType, Callable[..., list[Table]]] = {
    kernel: report.of_kernel,
    gaussian: report.of_gaussian,
    memory: report.of_memory,
    page: report.of_page,
    curve: report.of_curve,
    scale: report.of_scale,
    batch: report.of_batch,
    partitioned: report.of_partitioned,
    limits: report.of_limits,
}
"""Parts that measure one case after the other, and their tables."""


def run_cases(module: ModuleType, plan: Plan, store: Store) -> list[Table]:
    """One measurement for each case of a part."""
    cases = tuple(module.SMALL if plan.small else module.CASES)
    for case in cases:
        missing(store, partial(module.measure, case), module.PART, str(case))
    return OF_CASES[module](cases, store)


PARTS: dict[str, Callable[[Plan, Store], list[Table]]] = {
    "grid": run_grid,
    "growth": run_growth,
    **{module.PART: partial(run_cases, module) for module in OF_CASES},
    "startup": run_startup,
    "exactness": run_exactness,
}
"""In the order of the tables; measured last to first, for the grid fills what time is left."""


@click.command()
@click.option("--parts", default=",".join(PARTS), show_default=True, help="What to measure.")
@click.option(
    "--settings",
    multiple=True,
    metavar="M,T,AREA,NOISE",
    help="Settings of the grid instead of the usual seven; may be repeated.",
)
@click.option("--seeds", type=int, help=f"Draws of each setting.  [default: {SEEDS}]")
@click.option(
    "--scenes",
    type=click.IntRange(1),
    help="Scenes of each random family of exactness, fewer of the walks.  "
    f"[default: {exactness.Plan.scenes}]",
)
@click.option(
    "--families",
    multiple=True,
    type=click.Choice(exactness.FAMILIES),
    metavar="FAMILY",
    help="Families of exactness instead of all; may be repeated.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of exactness.")
@click.option("--jobs", type=click.IntRange(1), default=1, help="Processes of exactness.")
@click.option(
    "--budget",
    type=float,
    default=BUDGET,
    show_default=True,
    help="Seconds after which no draw but the first of a setting is begun.",
)
@click.option(
    "--picture", type=click.Path(path_type=Path), help="A picture of growth, as PNG or SVG."
)
@click.option(
    "--published",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Folder with TGOSPAMetric.py and utils.py of github.com/Agarciafernandez/"
    "T-GOSPA-metric-python, to measure that code as well.",
)
@click.option("--small", is_flag=True, help="Everything in its smallest size: tries the machinery.")
@click.option("--fresh", is_flag=True, help="Forget earlier measurements.")
@click.option("--markdown", is_flag=True, help="Print the tables as Markdown.")
def main(
    *,
    parts: str,
    settings: tuple[str, ...],
    seeds: int | None,
    scenes: int | None,
    families: tuple[str, ...],
    seed: int,
    jobs: int,
    budget: float,
    picture: Path | None,
    published: Path | None,
    small: bool,
    fresh: bool,
    markdown: bool,
) -> None:
    """Benchmarks of tgospa-eval: measures what is missing and prints tables of ratios."""
    Instance.published = published
    chosen = parts.split(",")
    unknown = [part for part in chosen if part not in PARTS]
    if unknown:
        raise click.BadParameter(f"no part {unknown[0]!r}; there are {', '.join(PARTS)}")
    plan = Plan(
        settings=tuple(map(Scene.parse, settings)) or (SMALL_SETTINGS if small else grid.SETTINGS),
        seeds=seeds or (SMALL_SEEDS if small else SEEDS),
        growth=growth.SMALL if small else growth.SERIES,
        picture=picture,
        small=small,
        exactness=exactness.Plan(
            scenes=scenes or (SMALL_SCENES if small else exactness.Plan.scenes),
            seed=seed,
            jobs=jobs,
            families=families or exactness.FAMILIES,
        ),
        deadline=time.monotonic() + budget,
    )
    store = Store(fresh=fresh)
    tables = {part: PARTS[part](plan, store) for part in reversed(PARTS) if part in chosen}
    for table in [*chain(*reversed(tables.values())), report.machine()]:
        click.echo(table.markdown() if markdown else table.plain())


if __name__ == "__main__":
    main()
