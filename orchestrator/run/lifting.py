"""When a vehicle left the ground, by its own estimate, which drifts while it still stands; pure.

A real autopilot's height wanders by decimetres before it lifts: PX4's own simulation by up to 0.3 m
between arming and taking off. So no height says that it flies; a climb that goes on does.
"""

_CLIMBS_M_S = 0.2
"""Faster than an estimate drifts upwards for long, slower than autopilots take off."""
_RISEN_M = 0.3
_ABOVE_M = 0.1


class Lift:
    """Takes heights of an armed vehicle, and knows the beginning of the climb that lifted it."""

    def __init__(self) -> None:
        self._climbs: tuple[float, float] | None = None
        self._climbed_s: float | None = None
        self._above_s: float | None = None

    @property
    def lifted_s(self) -> float | None:
        """Return when it began to climb; None before it did.

        Of one that climbs too slowly to tell, when it was last seen to come above 0.1 m.
        """
        return self._above_s if self._climbed_s is None else self._climbed_s

    def take(self, t_s: float, *, height_m: float, climb_m_s: float) -> None:
        """Take a height above where it stood and how fast that grows; armed vehicles only."""
        if self._climbed_s is not None:
            return
        if height_m <= _ABOVE_M:
            self._above_s = None
        elif self._above_s is None:
            self._above_s = t_s
        if climb_m_s < _CLIMBS_M_S:
            self._climbs = None
        elif self._climbs is None:
            self._climbs = (t_s, height_m)
        elif height_m - self._climbs[1] >= _RISEN_M:
            self._climbed_s = self._climbs[0]
