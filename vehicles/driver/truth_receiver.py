"""Receives a simulator's ground truth over MAVLink: dates it and maps it into the world frame."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.autopilot import Autopilot
from wil_campaign.vehicles.autopilots.ground_truth import GroundTruth, GroundTruthError
from wil_campaign.vehicles.autopilots.map_projections import MapProjection
from wil_campaign.vehicles.clocks.timesync import VehicleClock
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample
from wil_campaign.vehicles.poses.anchor import Anchor, PoseAverage
from wil_campaign.worlds.frames import Pose

_STILL_M = 0.1
"""How far the ground truth of a vehicle at rest may move."""
_NEIGHBOUR_S = 0.1
"""The newest telemetry dates a ground truth that arrives, or states a time, at most so far off."""
_STAMPED = (mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION)
"""The payload of both begins with time_boot_ms, and they come as often as the truth."""

TruthListener = Callable[[EstimateSample], None]


class _Stamp(NamedTuple):
    """The newest stamp of the vehicle's telemetry, and when it arrived."""

    boot_s: float
    arrived_s: float


class TruthReceiver:
    """Receives the ground truth of a vehicle's simulator, in the world frame.

    The messages give latitude, longitude and altitude. The first one is the origin of a frame in
    metres, by the autopilot's own projection; `anchor_at` maps it to the start pose, as it does an
    estimate. A message that states its time since boot gets that time, if the telemetry that
    arrived just before agrees within 0.1 s. Otherwise its time is that of the last telemetry, plus
    the time since that arrived; so both are late alike, whatever the link does. refused: why the
    last unusable message was not used; empty when there was none.
    """

    def __init__(self, *, session: MavlinkSession, clock: VehicleClock) -> None:
        self._session = session
        self._clock = clock
        self._listeners: list[TruthListener] = []
        self._read: Callable[[Any], GroundTruth] | None = None
        self._project: Callable[[float, float], MapProjection] | None = None
        self._origin: tuple[MapProjection, float] | None = None
        self._average = PoseAverage(still_within_m=_STILL_M)
        self._anchor: Anchor | None = None
        self._stamp: _Stamp | None = None
        self._last_s = -math.inf
        self.count = 0
        self.refused = ""

    @property
    def wanted(self) -> bool:
        """Return whether there is a listener."""
        return bool(self._listeners)

    def listen(self, listener: TruthListener) -> None:
        """Call a listener with each ground truth once it is anchored; before `begin`."""
        self._listeners.append(listener)

    def begin(self, autopilot: Autopilot) -> None:
        """Receive the autopilot's ground truth messages from now on, if there is a listener."""
        if not self.wanted:
            return
        self._read, self._project = autopilot.ground_truth, autopilot.projection
        for message_id in _STAMPED:
            self._session.on_payload(message_id, self._note_stamp)
        self._session.on(autopilot.truth_message_id, self._receive)

    def anchor_at(self, start: Pose) -> None:
        """Anchor the last second's mean ground truth at `start`; without any, do nothing.

        Raises AnchorError when the vehicle moves.
        """
        if self.count and self._average.rate_hz > 0.0:
            self._anchor = Anchor.of_poses(local=self._average.mean(), world=start)

    def rate_hz(self, now_s: float, *, fresh_s: float) -> float | None:
        """Return the rate of the ground truth in the last second, anchored or not.

        None when the newest is older than `fresh_s`, or too few have arrived.
        """
        return (self._average.rate_hz or None) if now_s - self._last_s <= fresh_s else None

    def restart(self) -> None:
        """Drop the ground truth from before a reboot: a simulator may restart at another place."""
        self._origin = self._anchor = self._stamp = None
        self._average = PoseAverage(still_within_m=_STILL_M)
        self._last_s = -math.inf

    def _note_stamp(self, payload: bytes, t_s: float) -> None:
        boot_s = int.from_bytes(payload[:4], "little") * 1e-3
        self._stamp = _Stamp(self._clock.since_boot(boot_s), t_s)

    def _receive(self, message: Any, arrived_s: float) -> None:
        if self._read is None:
            return
        try:
            truth = self._read(message)
        except GroundTruthError as error:
            self.refused = str(error)
            return
        self.count += 1
        t_s = self._time_of(truth, arrived_s)
        if t_s is None or t_s <= self._last_s:
            return
        self._last_s = t_s
        local = self._local(truth)
        self._average.add(t_s, local)
        anchor = self._anchor
        if anchor is None:
            return
        sample = EstimateSample(
            t_s,
            arrived_s,
            self._clock.boot_time(t_s),
            anchor.pose(local),
            anchor.velocity(truth.velocity_ned_m_s),
        )
        for listener in self._listeners:
            listener(sample)

    def _time_of(self, truth: GroundTruth, arrived_s: float) -> float | None:
        """Return the time (run clock) of a ground truth that arrived now; None while unknown.

        The time since the stamp includes any stall of the vehicle; so a message after a stall would
        get a later time than those that follow it in a burst.
        """
        stamp = self._stamp
        if stamp is None or arrived_s - stamp.arrived_s > _NEIGHBOUR_S:
            return None
        since_s, boot_s = arrived_s - stamp.arrived_s, stamp.boot_s
        if truth.boot_s is not None and abs(truth.boot_s - boot_s) <= _NEIGHBOUR_S:
            since_s, boot_s = 0.0, truth.boot_s
        try:
            return min(self._clock.run_time(boot_s) + since_s, arrived_s)
        except ValueError:
            return None  # The vehicle's clock is not synchronised yet.

    def _local(self, truth: GroundTruth) -> Pose:
        """Return a ground truth's pose in metres from the first one's position."""
        if self._origin is None:
            if self._project is None:
                raise RuntimeError("ground truth before `begin`")
            first = self._project(truth.latitude_deg, truth.longitude_deg)
            self._origin = first, truth.altitude_m
        projection, altitude_m = self._origin
        north_m, east_m = projection.to_metres(truth.latitude_deg, truth.longitude_deg)
        return Pose((north_m, east_m, altitude_m - truth.altitude_m), truth.q_wxyz)
