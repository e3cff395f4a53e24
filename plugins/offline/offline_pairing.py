"""Pairs real readings with the twin's where both are in files: no waiting, no late readings."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

from wil_campaign.recipes.pipeline.mixture import MixedReading
from wil_campaign.recipes.pipeline.pipeline import Mixer
from wil_campaign.vehicles.readings import CameraReading, Reading, reading_end_s

_NEAR_READINGS = 64


class TwinPairing(Protocol):
    """Pairs the twin's readings with real ones (protocol)."""

    def match(self, real: Reading) -> Reading | None:
        """Return the twin's reading to pair with a real one; called in order of time."""


@dataclass(frozen=True, slots=True)
class SingleTwinPairing:
    """Pairs one twin reading with all real ones: a single image beside a video."""

    reading: Reading

    def match(self, real: Reading) -> Reading:
        """Return the reading with the time of the real one."""
        return replace(self.reading, t_s=real.t_s, arrived_s=real.arrived_s, seq=real.seq)


@dataclass(frozen=True, slots=True)
class RenderedTwinPairing:
    """Pairs each real image with a rendered reading."""

    draw: Callable[[CameraReading], Reading]

    def match(self, real: Reading) -> Reading | None:
        """Return the reading rendered for this real image."""
        return self.draw(real) if isinstance(real, CameraReading) else None


class StreamedTwinPairing:
    """Pairs real readings with a file's twin readings nearest in time.

    offer: takes each reading, and returns why the mixer refuses it; else None.
    """

    def __init__(self, readings: Iterator[Reading], offer: Callable[[Reading], str | None]) -> None:
        self._readings = readings
        self._offer = offer
        self._near: deque[Reading] = deque(maxlen=_NEAR_READINGS)
        self.faults: list[str] = []

    def match(self, real: Reading) -> Reading | None:
        """Return the twin's reading nearest to the real one in time."""
        while not self._near or reading_end_s(self._near[-1]) < reading_end_s(real):
            following = next(self._readings, None)
            if following is None:
                break
            fault = self._offer(following)
            if fault is None:
                self._near.append(following)
            else:
                self.faults.append(fault)
        found = min(self._near, key=lambda one: abs(one.t_s - real.t_s), default=None)
        while len(self._near) > 1 and self._near[0] is not found:
            self._near.popleft()
        return found


@dataclass(frozen=True, slots=True)
class MixedPair:
    """A mixture and the pair of readings it was made of."""

    real: Reading
    twin: Reading | None
    mixed: MixedReading[Reading]


def paired_mixtures(
    mixer: Mixer, reals: Iterator[Reading], twins: TwinPairing
) -> Iterator[MixedPair]:
    """Yield the mixture of each real reading with its paired twin's. Raises StepError.

    The time of mixing is the arrival of the later one.
    """
    for real in reals:
        twin = twins.match(real)
        now_s = real.arrived_s if twin is None else max(real.arrived_s, twin.arrived_s)
        mixed: MixedReading[Reading] = mixer.mix(real, twin, now_s=now_s, alignment="from files")
        yield MixedPair(real, twin, mixed)
