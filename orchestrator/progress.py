"""What a run tells of itself while it flies; small, frozen, picklable."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Progress:
    """Where one run stands. Values that do not exist yet are None."""

    case: str
    mode: str
    repetition: int
    stage: str
    t_s: float
    mixing_rate_hz: float | None = None
    skew_ms: float | None = None
    clearance_m: float | None = None
    verdict_so_far: str | None = None
    text: str = ""


Report = Callable[[Progress], None]
