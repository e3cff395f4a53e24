"""The vehicle's own estimate: the truth, late and with errors that walk, as the profile says."""

import numpy as np

from vehicles.embedded.physics.motion_kernel import NUMBERS, estimate, read_and_estimate
from vehicles.embedded.physics.noise import GaussMarkov
from vehicles.embedded.profile import EstimatorNoise
from worlds.jit import F64, direct

_RADIANS_PER_DEGREE = 0.017453292519943295
_WALKS_HZ = 25
"""How often the errors walk; between two steps they stand."""


class Estimator:
    """The emulated estimator: estimates from true motion, one per physics step.

    Position starts at zero, wherever the errors stand: the estimator's origin is where it began.
    Body rates come from gyroscopes and carry no delay.
    """

    def __init__(self, *, noise: EstimatorNoise, rate_hz: int, rng: np.random.Generator) -> None:
        dt_s = 1.0 / _WALKS_HZ
        across, down = noise.position_sigma_m
        self._position = GaussMarkov(
            sigma=(across, across, down),
            time_constant_s=noise.position_time_constant_s,
            dt_s=dt_s,
            rng=rng,
        )
        across, down = noise.velocity_sigma_m_s
        self._velocity = GaussMarkov(
            sigma=(across, across, down),
            time_constant_s=noise.velocity_time_constant_s,
            dt_s=dt_s,
            rng=rng,
        )
        tilt, heading = noise.tilt_sigma_deg, noise.heading_sigma_deg
        self._angles = GaussMarkov(
            sigma=(
                tilt * _RADIANS_PER_DEGREE,
                tilt * _RADIANS_PER_DEGREE,
                heading * _RADIANS_PER_DEGREE,
            ),
            time_constant_s=noise.heading_time_constant_s,
            dt_s=dt_s,
            rng=rng,
        )
        self._origin = self._position.value
        self._late = np.zeros((1 + round(noise.delay_s * rate_hz), 6))
        self._every = rate_hz // _WALKS_HZ
        self._steps = 0
        self._read = direct(read_and_estimate)
        self._errors, self.present = np.zeros(9), np.zeros(NUMBERS)
        """The present estimate: the same array at each step."""

    def estimate(self, truth: F64) -> F64:
        """Return the estimate after one more step of true motion: motion arrays both."""
        self._walk()
        estimate(truth, self._errors, self._late, self._steps, self.present)
        self._steps += 1
        return self.present

    def read(self, raw: F64, zero: F64, truth: F64) -> int:
        """Set the true motion from JSBSim's numbers, and `present` to its estimate, one step on.

        Returns the bits of what holds (see motion_kernel); 0 where a number is not finite.
        """
        self._walk()
        bits: int = self._read(
            raw, zero, truth, self._errors, self._late, self._steps, self.present
        )
        self._steps += 1
        return bits

    def _walk(self) -> None:
        """Let the estimator's errors walk when they are due."""
        if self._steps % self._every == 0:
            (n, e, d), (on, oe, od) = self._position.advance(), self._origin
            self._errors[:] = (
                n - on, e - oe, d - od, *self._velocity.advance(), *self._angles.advance()
            )  # fmt: skip
