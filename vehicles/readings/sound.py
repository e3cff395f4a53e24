"""Readings of microphones: blocks of sound samples."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.readings.images import Source

SAMPLE_STEPS = 32768
"""Steps of 16-bit sound from silence to full scale."""


@dataclass(frozen=True, slots=True)
class MicrophoneReading:
    """A block of sound from one microphone.

    t_s: time of the first sample on the run clock. samples: (samples,) int16, as a digital
    microphone gives them. full_scale_pa: the sound pressure of 32768, so that the sounds of two
    microphones can be added in pascals.
    """

    t_s: float
    arrived_s: float
    seq: int
    source: Source
    samples: NDArray[np.int16]
    sample_rate_hz: int
    full_scale_pa: float
    sensor: str = ""

    @property
    def duration_s(self) -> float:
        """Return how long the block of sound lasts."""
        return len(self.samples) / self.sample_rate_hz

    @property
    def pressure_pa(self) -> NDArray[np.float32]:
        """Return the sound pressure in pascals, (samples,)."""
        return self.samples * np.float32(self.full_scale_pa / SAMPLE_STEPS)


def samples_from_pressure(
    pressure_pa: NDArray[np.float32] | NDArray[np.float64], full_scale_pa: float
) -> NDArray[np.int16]:
    """Return the 16-bit samples of a sound pressure, clipped at full scale."""
    steps = np.rint(pressure_pa * (SAMPLE_STEPS / full_scale_pa))
    samples: NDArray[np.int16] = np.clip(steps, -SAMPLE_STEPS, SAMPLE_STEPS - 1).astype(np.int16)
    return samples
