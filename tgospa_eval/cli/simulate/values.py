"""Options of ``simulate`` as a record."""

from tgospa_eval.api.request import Values
from tgospa_eval.common.frozen import dataclass


@dataclass(frozen=True, kw_only=True)
class SceneOptions(Values):
    """What to make; None where it depends on the others."""

    setting: str | None = None
    partitioned: str | None = None
    rows: int = 1_000_000
    scenario: str = "crossing"
    targets: int = 5
    steps: int = 60
    area: float = 200.0
    state: str | None = None
    particles: int | None = None
    seed: int = 0
    noise: float | None = None
    detection: float = 0.95
    confirmation: int = 0
    swaps: float = 0.25
    merges: float = 0.0
    near: float | None = None
    fragmentation: float = 0.01
    lost: int = 3
    latency: int = 0
    false_rate: float = 0.02
    false_length: tuple[int, int] = (3, 10)
    format_: str = "csv"
    force: bool = False
    quiet: bool = False
