"""Steps for sound: band-pass, decimation, addition."""

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field, field_validator, model_validator

from wil_campaign.plugins.microphone.audio import (
    AudioFilter,
    SoundLine,
    band_pass_kernel,
    low_pass_kernel,
)
from wil_campaign.recipes.model.registry import SidedParameters, StepContext, StepParameters, step
from wil_campaign.recipes.working import (
    SIDES,
    AnyMasked,
    CannotMixError,
    Masked,
    Merge,
    Operator,
    Side,
    Sides,
)
from wil_campaign.vehicles.readings import MicrophoneReading, samples_from_pressure

Work = Masked[MicrophoneReading]


class BandPassParameters(SidedParameters):
    """low_hz, high_hz: limits of the band; None: no limit. taps: length of the filter, odd.

    More taps give sharper edges: these are about 5.5 / taps of the sample rate wide.
    """

    low_hz: Annotated[float, Field(gt=0)] | None = None
    high_hz: Annotated[float, Field(gt=0)] | None = None
    taps: Annotated[int, Field(ge=15, le=4095)] = 401

    @field_validator("taps")
    @classmethod
    def _odd(cls, taps: int) -> int:
        """Refuse an even number of taps of the sound's band-pass."""
        if taps % 2 == 0:
            raise ValueError("must be odd")
        return taps

    @model_validator(mode="after")
    def _in_order(self) -> "BandPassParameters":
        """Require a limit of the sound's band, and low_hz below high_hz."""
        if self.low_hz is None and self.high_hz is None:
            raise ValueError("needs low_hz, high_hz, or both")
        if self.low_hz is not None and self.high_hz is not None and self.low_hz >= self.high_hz:
            raise ValueError("low_hz must be below high_hz")
        return self


@step("band_pass", stage="filter", sensors=("microphone",), parameters=BandPassParameters)
def band_pass(parameters: BandPassParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Keep the frequencies of a band, such as those of human speech, 300 to 3400 Hz.

    samples (samples,) int16 of a block to as many; t_s moves back by half of the filter's length,
    to the time at which the samples sounded. Consecutive blocks join without a click.
    """
    p = parameters
    filters: dict[int, AudioFilter] = {}

    def operator(work: Work, other: AnyMasked | None) -> Work:  # noqa: ARG001 - the interface
        rate = work.reading.sample_rate_hz
        if rate not in filters:
            filters.clear()
            low, high = (p.low_hz or 0.0) / rate, min(0.5, (p.high_hz or rate) / rate)
            if low >= 0.5:
                message = f"band_pass: {p.low_hz} Hz is beyond sound of {rate} Hz"
                raise CannotMixError("mismatch", message)
            filters[rate] = AudioFilter(band_pass_kernel(low, high, p.taps))
        return Masked(filters[rate].filtered(work.reading), work.mask)

    return operator


class DecimateSoundParameters(SidedParameters):
    """every: keeps each n-th sample, after a low-pass at 0.45 of the new rate."""

    shorthand = "every"

    every: Annotated[int, Field(ge=2, le=100)]


@step("decimate_sound", stage="filter", sensors=("microphone",), parameters=DecimateSoundParameters)
def decimate_sound(parameters: DecimateSoundParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Lower the sample rate by a whole factor, without aliasing.

    samples (n,) int16 to (n / every,), rounded up. A rate that the factor does not divide is a
    mismatch.
    """
    every = parameters.every
    smooth = AudioFilter(low_pass_kernel(0.45 / every, 32 * every + 1))

    def operator(work: Work, other: AnyMasked | None) -> Work:  # noqa: ARG001 - the interface
        block = work.reading
        if block.sample_rate_hz % every or len(block.samples) % every:
            message = f"{len(block.samples)} samples at {block.sample_rate_hz} Hz by {every}"
            raise CannotMixError("mismatch", f"decimate_sound: cannot divide {message}")
        made = smooth.filtered(block)
        samples = np.ascontiguousarray(made.samples[::every])
        return Masked(replace(made, samples=samples, sample_rate_hz=block.sample_rate_hz // every))

    return operator


class AddParameters(StepParameters):
    """real_gain, twin_gain: factors on the sound pressures; 0.5 each is their mean."""

    real_gain: Annotated[float, Field(ge=0, le=1000)] = 1.0
    twin_gain: Annotated[float, Field(ge=0, le=1000)] = 1.0


@step("add", stage="merge", sensors=("microphone",), parameters=AddParameters)
def add(parameters: AddParameters, context: StepContext) -> Merge:  # noqa: ARG001 - the interface of steps
    """Add the sounds of both sides, in pascals, each at the time at which it sounded.

    samples (samples,) int16 as many as of the real block, at its full scale, cut off where they
    exceed it; t_s is that of the side that begins earlier, as a filter or delay on one side makes
    it. Consecutive sums join without loss. Another sample rate of the twin's is a mismatch; where
    the twin's sound is not known for the whole time, the sum is left out ("no_twin").
    """
    lines: dict[Side, SoundLine] = {side: SoundLine() for side in SIDES}
    late_s = 0.0

    def merge(sides: Sides) -> MicrophoneReading:
        nonlocal late_s
        real: MicrophoneReading = sides["real"].reading
        lines["real"].add(real)
        if "twin" in sides:
            twin: MicrophoneReading = sides["twin"].reading
            if twin.sample_rate_hz != real.sample_rate_hz:
                rates = f"sound of {twin.sample_rate_hz} Hz over sound of {real.sample_rate_hz} Hz"
                raise CannotMixError("mismatch", rates)
            lines["twin"].add(twin)
            late_s = max(0.0, real.t_s - twin.t_s)
        # Also alone, so that the real sound goes on without a break where the twin's is missing.
        begin_s, count = real.t_s - late_s, len(real.samples)
        pressure_pa = lines["real"].sound_from(begin_s, count, is_whole=False)
        pressure_pa *= parameters.real_gain
        if "twin" in sides:
            pressure_pa += lines["twin"].sound_from(begin_s, count) * parameters.twin_gain
        samples = samples_from_pressure(pressure_pa, real.full_scale_pa)
        return replace(real, t_s=begin_s, samples=samples)

    return merge
