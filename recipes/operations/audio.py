"""Sound: FIR filters, and blocks on a common time line. Pure except for memory.

Filters are windowed sinc (Blackman), of linear phase, so that they only delay;
see Smith, "The Scientist and Engineer's Guide to Digital Signal Processing" (1997), chapter 16.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from recipes.working import CannotMixError
from vehicles.readings import MicrophoneReading, samples_from_pressure

Sound = NDArray[np.float64]


def low_pass(cutoff: float, taps: int) -> Sound:
    """Return the FIR low-pass kernel for audio; cutoff: of the sample rate, 0 to 0.5.

    taps: odd. Its sum is 1.
    """
    n = np.arange(taps) - (taps - 1) / 2
    kernel = 2.0 * cutoff * np.sinc(2.0 * cutoff * n) * np.blackman(taps)
    return np.asarray(kernel / kernel.sum(), np.float64)


def band_pass_kernel(low: float, high: float, taps: int) -> Sound:
    """Return the FIR band-pass kernel for audio between two fractions of the sample rate.

    low 0 passes all below `high`; high 0.5 all above `low`.
    """
    kernel = low_pass(high, taps) if high < 0.5 else _all(taps)
    return kernel if low <= 0.0 else kernel - low_pass(low, taps)


def _all(taps: int) -> Sound:
    """Return the audio kernel that passes every frequency."""
    kernel = np.zeros(taps)
    kernel[taps // 2] = 1.0
    return kernel


class Filter:
    """An FIR filter over consecutive audio blocks; restarts from silence after a gap.

    The output has the length of the input, and the time at which it sounded: earlier by half of
    the filter's length.
    """

    def __init__(self, kernel: Sound) -> None:
        self._kernel = kernel
        self._past = np.zeros(len(kernel) - 1)
        self._expected_s: float | None = None

    def filtered(self, block: MicrophoneReading) -> MicrophoneReading:
        """Return the audio block filtered."""
        if self._expected_s is None or abs(block.t_s - self._expected_s) > _GAP_SAMPLES / (
            block.sample_rate_hz
        ):
            self._past = np.zeros(len(self._kernel) - 1)
        self._expected_s = block.t_s + block.duration_s
        whole = np.concatenate([self._past, block.pressure_pa])
        self._past = whole[len(whole) - len(self._past) :]
        pressure = np.convolve(whole, self._kernel, mode="valid")
        late_s = (len(self._kernel) - 1) / 2 / block.sample_rate_hz
        samples = samples_from_pressure(pressure, block.full_scale_pa)
        return replace(block, t_s=block.t_s - late_s, samples=samples)


_GAP_SAMPLES = 1.5
"""Time stamps of consecutive blocks deviate by less, in samples."""


class TimeLine:
    """A buffer of the last audio blocks of a microphone, readable at any time."""

    def __init__(self) -> None:
        self._blocks: list[MicrophoneReading] = []

    def add(self, block: MicrophoneReading) -> None:
        """Add an audio block; one not newer than the last changes nothing."""
        if not self._blocks or block.t_s > self._blocks[-1].t_s:
            self._blocks.append(block)
            del self._blocks[:-_HELD_BLOCKS]

    def during(self, like: MicrophoneReading) -> Sound:
        """Return the audio pressure (Pa) at the sample times of another block, (samples,).

        Silence where there is no block. Raises CannotMixError for another sample rate.
        """
        rate, count = like.sample_rate_hz, len(like.samples)
        pressure_pa = np.zeros(count)
        for block in self._blocks:
            if block.sample_rate_hz != rate:
                raise CannotMixError(
                    "mismatch", f"sound of {block.sample_rate_hz} Hz over sound of {rate} Hz"
                )
            first = round((block.t_s - like.t_s) * rate)
            begin, end = max(0, first), min(count, first + len(block.samples))
            if begin < end:
                pressure_pa[begin:end] = block.pressure_pa[begin - first : end - first]
        return pressure_pa


_HELD_BLOCKS = 32
