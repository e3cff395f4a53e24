"""Receives the autopilot's estimates, and maps them to the run clock and the world frame.

Pairs the positions and attitudes of an estimator by their time since boot; pure.
"""

import math
from collections import deque
from collections.abc import Callable
from struct import Struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.clocks.timesync import VehicleClock
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample, LocalEstimate
from wil_campaign.vehicles.errors import AnchorError
from wil_campaign.vehicles.poses.anchor import Anchor, PoseAverage
from wil_campaign.worlds.frames import Pose, Quat, Vec3, quat_from_euler, slerp, subtract
from wil_campaign.worlds.geodesy import Geodetic, LocalFrame

_MAX_ATTITUDES = 16
_MOST_LATITUDE = 900_000_000
"""1e-7 degrees; INT32_MAX, MAVLink's word for unknown, is more."""
_REPORT_EVERY_S = 1.0
_REBOOT_S = 1.0
"""A time stamp that goes back by less was reordered or doubled; by more, the clock restarted."""


class EstimatePairing:
    """Pairs each estimated position with the attitude of the same time.

    A position waits for the first attitude that is not older, and gets the attitude interpolated
    at its time. If the next position comes first, it gets the last attitude when that is at most
    `max_age_s` old; otherwise it is dropped and counted, and so is one that is not newer than the
    one that waits: overtaken or doubled on the link. Times are seconds since boot.
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
            if boot_s > attitudes[-1][0] - _REBOOT_S:
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
            if self._waiting[0] - _REBOOT_S < boot_s <= self._waiting[0]:
                self.dropped += 1
                return ()
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


NO_PLACE_REMEDY = "wait for its GPS, or say gps: false of it if it flies without"
_POSITION: Struct = mavlink.MAVLink_local_position_ned_message.unpacker
_QUATERNION: Struct = mavlink.MAVLink_attitude_quaternion_message.unpacker
"""Both payloads have their fields in the order of their definition, time_boot_ms first."""

EstimateListener = Callable[[EstimateSample], None]


class Estimates:
    """Collects a vehicle's position and attitude estimates; calls listeners with each.

    Listeners are called once the vehicle is anchored, in the loop's turn in which the message
    came; what they raise goes to the loop's exception handler.
    """

    def __init__(self, *, session: MavlinkSession, clock: VehicleClock) -> None:
        self._session = session
        self._clock = clock
        self._pairing = EstimatePairing()
        self._listeners: list[EstimateListener] = []
        self._average = PoseAverage()
        self._anchor: Anchor | None = None
        self._takes_angles = True
        self._arrived_s = 0.0
        self.on_reboot: Callable[[float], None] | None = None
        """Called with the time of arrival when the vehicle's clock has started anew."""
        self.local: LocalEstimate | None = None
        self.newest: EstimateSample | None = None
        self._here: tuple[LocalFrame, Vec3] | None = None
        self.amsl_m: float | None = None
        """The vehicle's height above mean sea level by its own estimate."""
        self.on_unusable: Callable[[str, float], None] | None = None
        """Called with why a message that came at this time is not used, once a second."""
        self._reported_s = -math.inf
        session.on_payload(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, self._position)
        session.on_payload(mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, self._quaternion)
        session.on(mavlink.MAVLINK_MSG_ID_ATTITUDE, self._angles)
        session.on(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, self._global)
        session.on(mavlink.MAVLINK_MSG_ID_HOME_POSITION, self._home)

    @property
    def anchor(self) -> Anchor | None:
        """Return the anchor of the estimates' frame in the world; None while unknown."""
        return self._anchor

    @property
    def place_deg(self) -> tuple[float, float] | None:
        """Return latitude and longitude of the newest estimate; None while unknown."""
        if self._here is None:
            return None
        frame, _ = self._here
        return frame.latitude_deg, frame.longitude_deg

    @property
    def average(self) -> PoseAverage:
        """Return the mean of the last second's estimated local poses."""
        return self._average

    def set_anchor(self, anchor: Anchor) -> None:
        """Map estimates into the world by this anchor from now on."""
        self._anchor = anchor
        if self.local is not None:
            t_s = min(self._clock.run_time(self.local.boot_s), self._arrived_s)
            self._map(self.local, t_s, anchor)

    def anchor_at(self, start: Pose) -> None:
        """Anchor the last second's mean estimate at `start`. Raises AnchorError."""
        self.set_anchor(Anchor.of_poses(local=self._average.mean(), world=start))

    def place_of(self, world_ned_m: Vec3) -> Geodetic:
        """Return the latitude and longitude of a world place. Raises AnchorError if unknown."""
        if self._anchor is None or self._here is None:
            lacks = "is not anchored" if self._anchor is None else "has sent no GLOBAL_POSITION_INT"
            raise AnchorError(
                f"{self._session.link.name}: positions cannot be converted to latitude and "
                f"longitude: the vehicle {lacks}; {NO_PLACE_REMEDY}"
            )
        frame, local = self._here
        wanted = self._anchor.position_to_local(world_ned_m)
        return frame.to_geodetic(subtract(wanted, local))

    def listen(self, listener: EstimateListener) -> None:
        """Call a listener with each estimate."""
        self._listeners.append(listener)

    def _position(self, payload: bytes, t_s: float) -> None:
        boot_ms, x, y, z, vx, vy, vz = _unpack(_POSITION, payload)
        if not math.isfinite(x + y + z + vx + vy + vz):
            self._report_unusable("its LOCAL_POSITION_NED is not a number", t_s)
            return
        for estimate in self._pairing.position(
            self._clock.since_boot(boot_ms * 1e-3), (x, y, z), (vx, vy, vz)
        ):
            self._receive(estimate, t_s)

    def _quaternion(self, payload: bytes, t_s: float) -> None:
        boot_ms, w, x, y, z = _unpack(_QUATERNION, payload)[:5]
        # ATTITUDE is never requested, but ArduPilot may send it: one of the two is enough.
        if self._takes_angles:
            self._takes_angles = False
            self._session.off(mavlink.MAVLINK_MSG_ID_ATTITUDE, self._angles)
        self._attitude(boot_ms * 1e-3, (w, x, y, z), t_s)

    def _angles(self, message: Any, t_s: float) -> None:
        if not math.isfinite(message.roll + message.pitch + message.yaw):
            self._report_unusable("its ATTITUDE is not a number", t_s)
            return
        q_wxyz = quat_from_euler(message.roll, message.pitch, message.yaw)
        self._attitude(message.time_boot_ms * 1e-3, q_wxyz, t_s)

    def _attitude(
        self, boot_s: float, q_wxyz: tuple[float, float, float, float], t_s: float
    ) -> None:
        w, x, y, z = q_wxyz
        length = math.sqrt(w * w + x * x + y * y + z * z)
        if not 0.9 < length < 1.1:
            self._report_unusable("its ATTITUDE_QUATERNION is no rotation", t_s)
            return
        unit = (w / length, x / length, y / length, z / length)
        estimate = self._pairing.attitude(self._clock.since_boot(boot_s), unit)
        if estimate is not None:
            self._receive(estimate, t_s)

    def _report_unusable(self, why: str, t_s: float) -> None:
        if self.on_unusable is not None and t_s - self._reported_s >= _REPORT_EVERY_S:
            self._reported_s = t_s
            self.on_unusable(why, t_s)

    def _receive(self, estimate: LocalEstimate, arrived_s: float) -> None:
        last = self.local
        if last is not None and last.boot_s - _REBOOT_S < estimate.boot_s <= last.boot_s:
            return  # It came after a newer one, or a second time.
        self.local = estimate
        self._arrived_s = arrived_s
        reboots = self._clock.reboots
        t_s = self._clock.stamped(estimate.boot_s, arrived_s)
        if self._clock.reboots != reboots:
            self._restart()
            if self.on_reboot is not None:
                self.on_reboot(arrived_s)
        self._average.add(estimate.boot_s, estimate.pose)
        anchor = self._anchor
        if anchor is None:
            return
        sample = self._map(estimate, t_s, anchor)
        for listener in self._listeners:
            listener(sample)

    def _restart(self) -> None:
        # The estimator has a new origin: the old anchor no longer holds.
        self._pairing.restart()
        self._average = PoseAverage()
        self._anchor = None
        self.local = None
        self.newest = None
        self._here = None

    def _map(self, estimate: LocalEstimate, t_s: float, anchor: Anchor) -> EstimateSample:
        sample = EstimateSample(
            t_s,
            self._arrived_s,
            estimate.boot_s,
            anchor.pose(estimate.pose),
            anchor.velocity(estimate.velocity_ned_m_s),
        )
        self.newest = sample
        return sample

    def _global(self, message: Any, _t_s: float) -> None:
        if abs(message.lat) > _MOST_LATITUDE:
            return
        # ArduPilot sends zeros before it has a position.
        if message.lat or message.lon:
            self.amsl_m = message.alt * 1e-3
            if self.local is not None:
                # PX4's goes on beyond 180 degrees where the vehicle crosses the date line.
                longitude_deg = math.remainder(message.lon * 1e-7, 360.0)
                here = LocalFrame(message.lat * 1e-7, longitude_deg, self.amsl_m)
                self._here = (here, self.local.pose.position_ned_m)

    def _home(self, message: Any, _t_s: float) -> None:
        if self.amsl_m is None:
            self.amsl_m = message.altitude * 1e-3


def _unpack(layout: Struct, payload: bytes) -> tuple[float, ...]:
    """Return the fields of an estimate's payload, trailing zeros restored."""
    return layout.unpack(payload[: layout.size].ljust(layout.size, b"\0"))
