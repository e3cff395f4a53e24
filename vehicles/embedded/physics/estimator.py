"""The emulated estimator: the truth with the profile's delay and Gauss-Markov errors."""

import numpy as np

from wil_campaign.vehicles.embedded.physics.motion_kernel import (
    ERRORS,
    ESTIMATE,
    NO_LAW,
    Advance,
    estimate_motion,
    read_and_estimate_motion,
)
from wil_campaign.vehicles.embedded.physics.noise import GaussMarkov
from wil_campaign.vehicles.embedded.profile import EstimatorNoise
from wil_campaign.worlds.jit import F64, kernel_dispatcher

_RADIANS_PER_DEGREE = 0.017453292519943295
_ERRORS_HZ = 25
"""How often the errors change; in between they are constant."""


class EmulatedEstimator:
    """The emulated estimator: estimates from true motion, one per physics step.

    body: the body array (see motion_kernel) in which it keeps its errors and the present estimate.
    Position starts at zero, whatever the initial errors are: the estimator's origin is its start.
    Body rates come from gyroscopes and have no delay.
    """

    def __init__(
        self, *, noise: EstimatorNoise, rate_hz: int, rng: np.random.Generator, body: F64
    ) -> None:
        dt_s = 1.0 / _ERRORS_HZ
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
        self._every = rate_hz // _ERRORS_HZ
        self._steps = 0
        self._advance: Advance = kernel_dispatcher(read_and_estimate_motion)
        self._body, self._errors, self.present = body, body[ERRORS], body[ESTIMATE]
        """The present estimate: the same array at each step."""

    def estimate(self, truth: F64) -> F64:
        """Return the estimate after one more step of true motion: motion arrays both."""
        if self._steps % self._every == 0:
            self._advance_errors()
        estimate_motion(truth, self._errors, self._late, self._steps, self.present)
        self._steps += 1
        return self.present

    def advance_by(self, kernel: Advance) -> None:
        """Let `read` run the control law that is part of a kernel."""
        self._advance = kernel_dispatcher(kernel)

    def read(self, outer: int = NO_LAW) -> int:
        """Set the true motion from the plant's numbers, and `present` to its estimate, one step on.

        outer: the law's outer steps. Returns the bits of `motion_kernel.read`, and FLOWN when the
        law was run; 0 when a number is not finite.
        """
        steps = self._steps
        if steps % self._every == 0:
            self._advance_errors()
        self._steps = steps + 1
        return self._advance(self._body, self._late, steps, outer)

    def _advance_errors(self) -> None:
        """Advance the estimator's errors."""
        (n, e, d), (on, oe, od) = self._position.advance(), self._origin
        self._errors[:] = (
            n - on, e - oe, d - od, *self._velocity.advance(), *self._angles.advance()
        )  # fmt: skip
