"""Who meets whom where both worlds are on the disk: nobody waits, and nothing comes too late."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

from recipes.pipeline.mixture import Mixed
from recipes.pipeline.pipeline import Mixer
from vehicles.readings import CameraReading, Reading

_KEPT = 64


class Twins(Protocol):
    """Gives the twin's reading for a real one."""

    def meeting(self, real: Reading) -> Reading | None:
        """Return the reading to be mixed with this one; called in the order of time."""


@dataclass(frozen=True, slots=True)
class HeldTwins:
    """One reading for all times: a single image beside a video."""

    reading: Reading

    def meeting(self, real: Reading) -> Reading:
        """Return the reading as if taken at the moment of the real one."""
        return replace(self.reading, t_s=real.t_s, arrived_s=real.arrived_s, seq=real.seq)


@dataclass(frozen=True, slots=True)
class DrawnTwins:
    """A reading made for each real picture."""

    draw: Callable[[CameraReading], Reading]

    def meeting(self, real: Reading) -> Reading | None:
        """Return what is drawn for this picture."""
        return self.draw(real) if isinstance(real, CameraReading) else None


class StreamedTwins:
    """Readings of a file in the order of time; the nearest in time is met.

    offer: is handed each reading as it comes, and says what is wrong with it.
    """

    def __init__(self, readings: Iterator[Reading], offer: Callable[[Reading], str | None]) -> None:
        self._readings = readings
        self._offer = offer
        self._near: deque[Reading] = deque(maxlen=_KEPT)
        self.faults: list[str] = []

    def meeting(self, real: Reading) -> Reading | None:
        """Return the reading nearest to the real one in time."""
        while not self._near or self._near[-1].t_s < real.t_s:
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
    """A mixture and what it was made of."""

    real: Reading
    twin: Reading | None
    mixed: Mixed[Reading]


def mixtures(mixer: Mixer, reals: Iterator[Reading], twins: Twins) -> Iterator[MixedPair]:
    """Yield the mixture of each real reading. Raises StepError.

    It is mixed when both are there: latency is that of the later one.
    """
    for real in reals:
        twin = twins.meeting(real)
        now_s = real.arrived_s if twin is None else max(real.arrived_s, twin.arrived_s)
        mixed: Mixed[Reading] = mixer.mix(real, twin, now_s=now_s, alignment="from files")
        yield MixedPair(real, twin, mixed)
