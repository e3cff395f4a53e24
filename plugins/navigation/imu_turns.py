"""Whether a gyroscope turned as its vehicle did: one in degrees turns 57 times as far; pure."""

import math

from wil_campaign.vehicles.readings import ImuReading
from wil_campaign.worlds.frames import Pose, Vec3, add, angle_between, norm, scale

_SPAN_S = 0.5
"""Over so long a stretch attitude and rates are compared, whatever clock each is stamped by."""
_LONGEST_STEP_S = 0.1
"""Rates are not known over a longer gap."""
_TIMES = 10.0
"""A unit or a scale that is wrong is off by more; a clock or a vibration by less."""
_NOISE_RAD, _TURNED_RAD = 0.5, 0.2
"""A turn that is no noise of a gyroscope; of an attitude."""
_STRETCHES = 4
"""So many contradict each other before a sensor is called wrong: an attitude may step."""


class TurnCheck:
    """Compares the turns of a gyroscope with those of its vehicle's attitude, in stretches."""

    def __init__(self) -> None:
        self._begin: tuple[float, Pose] | None = None
        self._last_s = -math.inf
        self._turn_rad: Vec3 = (0.0, 0.0, 0.0)
        self._wrong = 0
        self._text: str | None = None

    def receive(self, reading: ImuReading, pose: Pose) -> str | None:
        """Return what is wrong with a gyroscope, in words; None for nothing."""
        step_s, self._last_s = reading.t_s - self._last_s, reading.t_s
        if self._begin is None or not 0.0 < step_s <= _LONGEST_STEP_S:
            self._restart(reading, pose)
            return self._text
        self._turn_rad = add(self._turn_rad, scale(reading.rates_frd_rad_s, step_s))
        since_s, before = self._begin
        if reading.t_s - since_s >= _SPAN_S:
            self._compare(norm(self._turn_rad), angle_between(before.q_wxyz, pose.q_wxyz))
            self._restart(reading, pose)
        return self._text

    def _restart(self, reading: ImuReading, pose: Pose) -> None:
        self._begin, self._turn_rad = (reading.t_s, pose), (0.0, 0.0, 0.0)

    def _compare(self, by_rates_rad: float, turned_rad: float) -> None:
        too_far = by_rates_rad > _NOISE_RAD + _TIMES * turned_rad
        too_little = turned_rad > _TURNED_RAD + _TIMES * by_rates_rad
        self._wrong += too_far or too_little
        if self._wrong < _STRETCHES or self._text is not None:
            return
        by, turned = math.degrees(by_rates_rad), math.degrees(turned_rad)
        self._text = (
            f"its rates turn by {by:.3g} deg within {_SPAN_S:g} s where the vehicle turned by "
            f"{turned:.2g} deg: their unit is wrong (rad/s is expected), or their scale"
        )
