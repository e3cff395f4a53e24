"""First-order Gauss-Markov noise along three axes."""

import math

import numpy as np

from wil_campaign.worlds.frames import Vec3


class GaussMarkov:
    """Gauss-Markov noise of zero mean along three axes, stationary from the start.

    x[k+1] = a x[k] + sigma sqrt(1 - a^2) n, a = exp(-dt / time constant): exact for any step
    (Gelb, "Applied Optimal Estimation", 1974, section 3.8).
    """

    _BLOCK = 256

    def __init__(
        self,
        *,
        sigma: Vec3,
        time_constant_s: float,
        dt_s: float,
        rng: np.random.Generator,
    ) -> None:
        self._keep = math.exp(-dt_s / time_constant_s)
        self._kick = [s * math.sqrt(1.0 - self._keep**2) for s in sigma]
        self._rng = rng
        self._kicks: list[list[float]] = []
        x, y, z = (rng.standard_normal(3) * sigma).tolist()
        self.value: Vec3 = (x, y, z)
        """The present values."""
        self._silent = not any(sigma)

    def advance(self) -> Vec3:
        """Advance the noise by one step and return its values."""
        if self._silent:
            return self.value
        if not self._kicks:
            self._kicks = (self._rng.standard_normal((self._BLOCK, 3)) * self._kick).tolist()
        keep, (x, y, z), (a, b, c) = self._keep, self.value, self._kicks.pop()
        self.value = value = (keep * x + a, keep * y + b, keep * z + c)
        return value
