"""The noise of a sensor, as sets that profiles name; each stands by the model of its sensor."""

from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

Noise = TypeVar("Noise")

NoiseSetName = Literal["ideal", "datasheet"]
"""What a profile of an embedded vehicle says under `sensors`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseSets(Generic[Noise]):
    """The noise settings of one sensor by the names of their sets.

    ideal: a simulator's idea of it: its reach, and no noise. datasheet: what its data sheet
    promises.
    """

    ideal: Noise
    datasheet: Noise

    def named(self, name: NoiseSetName) -> Noise:
        """Return the sensor's noise settings of a set."""
        return self.ideal if name == "ideal" else self.datasheet
