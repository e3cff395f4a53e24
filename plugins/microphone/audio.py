"""Sound: FIR filters, and blocks on a common time line. Pure except for memory.

Filters are windowed sinc (Blackman), of linear phase, so that they only delay;
see Smith, "The Scientist and Engineer's Guide to Digital Signal Processing" (1997), chapter 16.
"""

import math
from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wil_campaign.recipes.working import CannotMixError
from wil_campaign.vehicles.readings import MicrophoneReading, reading_end_s, samples_from_pressure

Sound = NDArray[np.float64]


def low_pass_kernel(cutoff: float, taps: int) -> Sound:
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
    kernel = low_pass_kernel(high, taps) if high < 0.5 else _all(taps)
    return kernel if low <= 0.0 else kernel - low_pass_kernel(low, taps)


def _all(taps: int) -> Sound:
    """Return the audio kernel that passes every frequency."""
    kernel = np.zeros(taps)
    kernel[taps // 2] = 1.0
    return kernel


class AudioFilter:
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


class SoundLine:
    """A buffer of the last seconds of a microphone's sound, readable at any time.

    is_steady: stamps of consecutive blocks may deviate by up to half a block, 20 ms at most, as
    those of a live microphone do: such a block follows the last one, a sample nearer to its stamp.
    """

    def __init__(self, *, is_steady: bool = False) -> None:
        self._is_steady = is_steady
        self._blocks: deque[MicrophoneReading] = deque()
        self._stamp_s = -math.inf

    def add(self, block: MicrophoneReading) -> None:
        """Add an audio block; one not newer than the last changes nothing.

        With a block of another sample rate the line begins anew.
        """
        if block.t_s <= self._stamp_s:
            return
        self._stamp_s = block.t_s
        if self._blocks and block.sample_rate_hz != self._blocks[-1].sample_rate_hz:
            self._blocks.clear()
        self._blocks.append(self._joined(block) if self._is_steady else block)
        while reading_end_s(self._blocks[0]) < block.t_s - _HELD_S:
            self._blocks.popleft()

    def _joined(self, block: MicrophoneReading) -> MicrophoneReading:
        """Return an audio block at the end of the line where it follows; as it is at a hole."""
        sample_s = 1.0 / block.sample_rate_hz
        late_s = block.t_s - reading_end_s(self._blocks[-1]) if self._blocks else 0.0
        if not _JITTER_SAMPLES * sample_s < abs(late_s) < min(_JITTER_S, block.duration_s / 2.0):
            return block
        return replace(block, t_s=block.t_s - late_s + math.copysign(sample_s, late_s))

    def during(self, real: MicrophoneReading, like: MicrophoneReading) -> MicrophoneReading:
        """Return the line's audio block for exactly the time of a real one.

        It has the line's sample rate, number and full scale of another block. Blocks of consecutive
        times join: each sample of the line is in one of them. Raises CannotMixError for sound that
        is not known.
        """
        rate = self._blocks[-1].sample_rate_hz
        count = _index(reading_end_s(real), rate) - _index(real.t_s, rate)
        samples = samples_from_pressure(self.sound_from(real.t_s, count), like.full_scale_pa)
        return replace(like, t_s=real.t_s, sample_rate_hz=rate, samples=samples)

    def sound_from(self, begin_s: float, count: int, *, is_whole: bool = True) -> Sound:
        """Return the audio pressure (Pa) of so many samples from a time on, (samples,).

        is_whole: raises CannotMixError where more is missing than the jitter of time stamps leaves
        between two blocks; else that is silence.
        """
        pressure_pa, known, missing = np.zeros(count), count, 0
        for block in reversed(self._blocks):
            rate = block.sample_rate_hz
            first = _index(block.t_s, rate) - _index(begin_s, rate)
            begin, end = max(0, first), min(known, first + len(block.samples))
            if begin < end:
                pressure_pa[begin:end] = block.pressure_pa[begin - first : end - first]
                missing += _hole(known - end)
                known = begin
            if first <= 0:
                break
        missing += _hole(known)
        if is_whole and missing > 0:
            share = math.floor(100 * (1.0 - missing / count))
            raise CannotMixError("no_twin", f"the twin's sound covers {share} % of the block")
        return pressure_pa


def _index(t_s: float, rate_hz: int) -> int:
    """Return the number of the audio sample at a time.

    Halves are rounded up whatever the last digits of the time, so that blocks keep their distance.
    """
    return math.floor(t_s * rate_hz + 0.501)


def _hole(samples: int) -> int:
    """Return how many audio samples are missing in a hole; 0 where it is jitter of time stamps."""
    return samples if samples > _JITTER_SAMPLES else 0


_JITTER_SAMPLES = 2
_JITTER_S = 0.02
_HELD_S = 10.0
"""How much sound a line holds: longer than a block and its latency."""
