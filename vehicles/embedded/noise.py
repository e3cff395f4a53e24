"""First-order Gauss-Markov noise: what walks, and comes back."""

import math

import numpy as np


class GaussMarkov:
    """Independent walks of zero mean, one per axis, started from their stationary spread.

    x[k+1] = a x[k] + sigma sqrt(1 - a^2) n, a = exp(-dt / time constant): exact for any step
    (Gelb, "Applied Optimal Estimation", 1974, section 3.8).
    """

    _BLOCK = 256

    def __init__(
        self,
        *,
        sigma: tuple[float, ...],
        time_constant_s: float,
        dt_s: float,
        rng: np.random.Generator,
    ) -> None:
        self._keep = math.exp(-dt_s / time_constant_s)
        self._kick = tuple(s * math.sqrt(1.0 - self._keep**2) for s in sigma)
        self._rng = rng
        self._normals: list[list[float]] = []
        start = rng.standard_normal(len(sigma)).tolist()
        self.value: tuple[float, ...] = tuple(s * n for s, n in zip(sigma, start, strict=True))
        """The present values."""
        self._silent = not any(sigma)

    def advance(self) -> tuple[float, ...]:
        """Step once and return the new values."""
        if self._silent:
            return self.value
        if not self._normals:
            self._normals = self._rng.standard_normal((self._BLOCK, len(self._kick))).tolist()
        keep = self._keep
        self.value = tuple(
            keep * x + kick * n
            for x, kick, n in zip(self.value, self._kick, self._normals.pop(), strict=True)
        )
        return self.value
