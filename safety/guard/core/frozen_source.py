"""Detects a position source that repeats one position while the vehicle itself moves; pure."""

from typing import NamedTuple

from wil_campaign.worlds.frames import Vec3, norm, subtract

_MOVED_M, _MOVED_ON_GROUND_M = 0.5, 1.5
"""More than an estimate at rest wanders while a source reports the same position by chance; and
more than it is corrected by while its vehicle stands, whose source repeats for as long."""


class _EqualPositions(NamedTuple):
    """The first of a series of equal positions, and where the vehicle's own estimate was then.

    low: at the height at which the vehicle stood.
    """

    position_m: Vec3
    t_s: float
    estimate_m: Vec3
    low: bool


class FrozenSource:
    """Detects a frozen position source by the vehicle's own estimate, in any frame.

    same_s: how long a position may stay the same. Equal positions of a vehicle whose estimate stays
    where it is are of one that stands or hovers.
    """

    def __init__(self, *, same_s: float) -> None:
        self._same_s = same_s
        self._since: _EqualPositions | None = None
        self._estimate_m: Vec3 | None = None

    def note_estimate(self, position_m: Vec3) -> None:
        """Record the vehicle's own estimate of its position."""
        self._estimate_m = position_m

    def note_position(
        self, position_m: Vec3, t_s: float, *, on_ground: bool, low: bool = False
    ) -> None:
        """Record a position of the source. on_ground: the vehicle reports that it stands.

        low: it is where the vehicle stood. An autopilot reports a takeoff before it leaves the
        ground, and its landing seconds after.
        """
        since, estimate_m = self._since, self._estimate_m
        if since is not None and since.position_m == position_m and not on_ground:
            return
        self._since = (
            None if estimate_m is None else _EqualPositions(position_m, t_s, estimate_m, low)
        )

    def is_frozen(self, t_s: float) -> bool:
        """Return whether the source repeats one position while the estimate has moved."""
        since, estimate_m = self._since, self._estimate_m
        if since is None or estimate_m is None or t_s - since.t_s <= self._same_s:
            return False
        most_m = _MOVED_ON_GROUND_M if since.low else _MOVED_M
        return norm(subtract(estimate_m, since.estimate_m)) > most_m
