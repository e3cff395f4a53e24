"""Pairs the positions and attitudes of an estimator by their time since boot; pure."""

from collections import deque

from wil_campaign.vehicles.driver.vehicle_state import LocalEstimate
from wil_campaign.worlds.frames import Pose, Quat, Vec3, slerp

_MAX_ATTITUDES = 16


class EstimatePairing:
    """Pairs each estimated position with the attitude of the same time.

    A position waits for the first attitude that is not older, and gets the attitude interpolated
    at its time. If the next position comes first, it gets the last attitude when that is at most
    `max_age_s` old; otherwise it is dropped and counted. Times are seconds since boot.
    """

    def __init__(self, *, max_age_s: float = 0.2) -> None:
        self._max_age_s = max_age_s
        self._attitudes: deque[tuple[float, Quat]] = deque(maxlen=_MAX_ATTITUDES)
        self._waiting: tuple[float, Vec3, Vec3] | None = None
        self.dropped = 0

    def attitude(self, boot_s: float, q_wxyz: Quat) -> LocalEstimate | None:
        """Take an attitude; return the estimate that it completes."""
        attitudes = self._attitudes
        if attitudes and boot_s < attitudes[-1][0]:
            if boot_s > attitudes[-1][0] - 1.0:
                return None
            self.restart()
        attitudes.append((boot_s, q_wxyz))
        waiting = self._waiting
        if waiting is None or boot_s < waiting[0]:
            return None
        self._waiting = None
        return self._complete(*waiting)

    def position(
        self, boot_s: float, position_ned_m: Vec3, velocity_ned_m_s: Vec3
    ) -> tuple[LocalEstimate, ...]:
        """Take a position; return the estimates complete now, in order of time."""
        late: LocalEstimate | None = None
        if self._waiting is not None:
            late = self._complete(*self._waiting)
            self._waiting = None
        if self._attitudes and self._attitudes[-1][0] >= boot_s:
            now = self._complete(boot_s, position_ned_m, velocity_ned_m_s)
            return tuple(each for each in (late, now) if each is not None)
        self._waiting = (boot_s, position_ned_m, velocity_ned_m_s)
        return () if late is None else (late,)

    def restart(self) -> None:
        """Forget unpaired estimates: the vehicle's clock restarted."""
        self._attitudes.clear()
        self._waiting = None

    def _complete(self, boot_s: float, position: Vec3, velocity: Vec3) -> LocalEstimate | None:
        q_wxyz = self._attitude_at(boot_s)
        if q_wxyz is None:
            self.dropped += 1
            return None
        return LocalEstimate(boot_s, Pose(position, q_wxyz), velocity)

    def _attitude_at(self, boot_s: float) -> Quat | None:
        after: tuple[float, Quat] | None = None
        for sample in reversed(self._attitudes):
            if sample[0] == boot_s:
                return sample[1]
            if sample[0] < boot_s:
                if after is not None:
                    share = (boot_s - sample[0]) / (after[0] - sample[0])
                    return slerp(sample[1], after[1], share)
                return sample[1] if boot_s - sample[0] <= self._max_age_s else None
            after = sample
        if after is not None and after[0] - boot_s <= self._max_age_s:
            return after[1]
        return None
