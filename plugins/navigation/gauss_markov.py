"""First-order Gauss-Markov errors: random walks that return to zero."""

import math

import numpy as np


class GaussMarkovWalk:
    """Gauss-Markov errors of zero mean, one per axis, at moments that never go back.

    sigma: stationary standard deviation per axis. x' = a x + sigma sqrt(1 - a^2) n with
    a = exp(-dt / time constant): exact for any step (Gelb, "Applied Optimal Estimation", 1974,
    section 3.8). The first value is drawn from the stationary spread.
    """

    def __init__(self, *, sigma: tuple[float, ...], time_constant_s: float) -> None:
        self._sigma = sigma
        self._time_constant_s = time_constant_s
        self._silent = not any(sigma)
        self._value = (0.0,) * len(sigma)
        self._t_s: float | None = None

    def at(self, t_s: float, rng: np.random.Generator) -> tuple[float, ...]:
        """Return the Gauss-Markov errors at t_s."""
        if self._silent:
            return self._value
        keep = 0.0
        if self._t_s is not None:
            keep = math.exp((self._t_s - t_s) / self._time_constant_s)
        kick = math.sqrt(max(0.0, 1.0 - keep * keep))
        normals = rng.standard_normal(len(self._sigma)).tolist()
        self._value = tuple(
            keep * value + kick * sigma * normal
            for value, sigma, normal in zip(self._value, self._sigma, normals, strict=True)
        )
        self._t_s = t_s
        return self._value
