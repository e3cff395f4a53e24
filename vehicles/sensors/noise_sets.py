"""Named sets of a sensor's noise settings, which profiles choose from."""

from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

Noise = TypeVar("Noise")

NoiseSetName = Literal["ideal", "datasheet"]
"""The value of `sensors` in a profile of an embedded vehicle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseSets(Generic[Noise]):
    """The noise settings of one sensor by the names of their sets.

    ideal: its range limits without noise, as most simulators have it. datasheet: the figures of
    its data sheet.
    """

    ideal: Noise
    datasheet: Noise

    def named(self, name: NoiseSetName) -> Noise:
        """Return the sensor's noise settings of a set."""
        return self.ideal if name == "ideal" else self.datasheet
