"""The gate's estimated place: a filter over sights, in the flight frame."""

from wil_campaign.api import Vec3

from .gate_range import ASSUMED_WIDTH_M, Looming
from .gate_sight import GateBearing, GateSight

ASSUMED_RANGE_M = 3.0
"""Used until the gate's opening is seen; in the paper the gate is 3 m ahead."""

BLEND = 0.5
"""Weight of a new sight of the centre; old ones are from farther away."""

NEAREST_M = 0.2

BLIND_WIDTHS = 0.95
"""At so many widths from the gate its frame fills the image of a camera of 69 degrees."""

BLIND_M = 0.45


class GateTrack:
    """The estimated place of the gate: metres ahead, right and down of the start."""

    def __init__(self, right_m: float, down_m: float) -> None:
        self.right_m = right_m
        self.down_m = down_m
        self.along_m = ASSUMED_RANGE_M
        self.width_m = ASSUMED_WIDTH_M
        self.seen_s: float | None = None
        self.only_side = False
        self._looming = Looming()
        self._centred = [False, False]

    def near(self, along_m: float) -> bool:
        """Return whether the tracked gate's frame is leaving the image, or has left it."""
        blind_m = max(BLIND_M, BLIND_WIDTHS * self.width_m)
        return self.seen_s is not None and self.along_m - along_m < blind_m

    def seen_within(self, now_s: float, limit_s: float) -> bool:
        """Return whether an image of at most this age showed the gate."""
        return self.seen_s is not None and now_s - self.seen_s <= limit_s

    def update(self, sight: GateSight, at_m: Vec3, t_s: float) -> None:
        """Update the gate's estimated place by a sight at a time (metres ahead, right, down).

        Near the gate only a sight that gives the centre counts: bars that leave the image would
        pull the aim to the side on which they are still seen.
        """
        if sight.right is None and sight.down is None:
            return
        if self.near(at_m[0]) and (sight.only_side or sight.width is None):
            return
        self._update_range(sight, at_m[0])
        self.seen_s, self.only_side = t_s, sight.only_side
        range_m = max(NEAREST_M, self.along_m - at_m[0])
        self.right_m = self._aim(0, sight.right, self.right_m, at_m[1], range_m)
        self.down_m = self._aim(1, sight.down, self.down_m, at_m[2], range_m)

    def _update_range(self, sight: GateSight, at_m: float) -> None:
        """Update the range and width of the gate: by its growth, else by an assumed size."""
        if sight.width is None or sight.width <= 0.0:
            self.along_m = max(self.along_m, at_m + ASSUMED_WIDTH_M)
            return
        self._looming.add(at_m, sight.width)
        fit = self._looming.fit()
        if fit is None:
            self.width_m, self.along_m = ASSUMED_WIDTH_M, at_m + ASSUMED_WIDTH_M / sight.width
        else:
            self.width_m, self.along_m = fit.width_m, fit.along_m

    def _aim(
        self, axis: int, bearing: GateBearing | None, old_m: float, at_m: float, range_m: float
    ) -> float:
        if bearing is None:
            return old_m
        new_m = at_m + bearing.slope * range_m
        first = not self._centred[axis]
        self._centred[axis] = not bearing.only_side
        if bearing.only_side or first:
            return new_m
        return old_m + BLEND * (new_m - old_m)
