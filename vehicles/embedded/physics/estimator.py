"""The vehicle's own estimate: the truth, late and with errors that walk, as the profile says."""

from collections import deque

import numpy as np

from vehicles.embedded.physics.noise import GaussMarkov
from vehicles.embedded.physics.states import Motion
from vehicles.embedded.profile import EstimatorNoise
from worlds.frames import Vec3, wrap_pi

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
        self._late: deque[tuple[Vec3, Vec3]] = deque(maxlen=1 + round(noise.delay_s * rate_hz))
        self._every = rate_hz // _WALKS_HZ
        self._steps = 0

    def estimate(self, truth: Motion) -> Motion:
        """Return the estimate after one more step of true motion."""
        if self._steps % self._every == 0:
            self._position.advance()
            self._velocity.advance()
            self._angles.advance()
        self._steps += 1
        position, velocity, (roll, pitch, yaw), rates, force = truth
        self._late.append((position, velocity))
        (n, e, d), (vn, ve, vd) = self._late[0]
        bn, be, bd = self._position.value
        on, oe, od = self._origin
        wn, we, wd = self._velocity.value
        a, b, c = self._angles.value
        return Motion(
            (n + bn - on, e + be - oe, d + bd - od),
            (vn + wn, ve + we, vd + wd),
            (roll + a, pitch + b, wrap_pi(yaw + c)),
            rates,
            force,
        )
