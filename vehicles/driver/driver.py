"""Flies one vehicle over MAVLink, whichever autopilot it has."""

import asyncio
import math
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, Self

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.tasks import open_task_group, stop_tasks
from wil_campaign.vehicles.autopilots.autopilot import FlightMode, MavlinkTarget, TelemetryRates
from wil_campaign.vehicles.clocks.timesync import VehicleClock
from wil_campaign.vehicles.driver.command_backend import (
    CommandBackend,
    FailureListener,
    FrameBackend,
)
from wil_campaign.vehicles.driver.confirmed_command import SEEN_WITHIN_S, ConfirmedCommand
from wil_campaign.vehicles.driver.estimate_accuracy import EstimateAccuracy
from wil_campaign.vehicles.driver.estimates import EstimateListener, Estimates
from wil_campaign.vehicles.driver.heading_monitor import HeadingListener, HeadingMonitor
from wil_campaign.vehicles.driver.identified_vehicle import IdentifiedVehicle
from wil_campaign.vehicles.driver.onboard.gps_receiver import GroundSpeed
from wil_campaign.vehicles.driver.onboard.parameter_digest import ParameterDigest
from wil_campaign.vehicles.driver.refusals import arm_refused_error, not_ready_error
from wil_campaign.vehicles.driver.session.commands import Commander
from wil_campaign.vehicles.driver.session.conditions import ConditionWaiter
from wil_campaign.vehicles.driver.session.identification import find_vehicle, request_identity
from wil_campaign.vehicles.driver.session.identity import VehicleIdentity, WantedVehicle
from wil_campaign.vehicles.driver.session.link_monitor import LinkMonitor
from wil_campaign.vehicles.driver.session.session import Handler, MavlinkSession
from wil_campaign.vehicles.driver.session.timesync_requests import TimesyncRequester
from wil_campaign.vehicles.driver.setpoint_sender import SetpointSender
from wil_campaign.vehicles.driver.status_tracker import EventListener, StatusTracker
from wil_campaign.vehicles.driver.telemetry_streams import TelemetryStreams
from wil_campaign.vehicles.driver.truth_receiver import TruthListener, TruthReceiver
from wil_campaign.vehicles.driver.vehicle_state import (
    EstimateSample,
    ReportName,
    VehicleEvent,
    VehicleState,
)
from wil_campaign.vehicles.errors import (
    AnchorError,
    CommandError,
    StateTimeoutError,
    VehicleError,
)
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.links.udp import RIVAL_REMEDY
from wil_campaign.vehicles.mavlink.heartbeats import HeartbeatKind
from wil_campaign.vehicles.poses.anchor import Anchor
from wil_campaign.vehicles.setpoints import Setpoint
from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.geodesy import Geodetic, LocalFrame

_REQUEST_AGAIN_S = 2.0
_GROUND_SPEED_HZ = 2.0
_ACCURACY_HZ = 2.0
_DISARMS_ITSELF_S = 5.0
"""After the touchdown; by default PX4 takes 2 s (COM_DISARM_LAND), and ArduCopter's LAND none."""
_MAGNETOMETER_HZ = 2.0
_ANSWER_WITHIN_S = 1.0
"""Time to identify itself that is left to a vehicle whose first heartbeat came at the deadline."""


class Driver:
    """The driver of one vehicle at the end of a link; an async context manager.

    In order: `identify`, `ready`, `arm`, `begin_takeoff`, `enter_guided`, `send`, `land`,
    `disarmed`. Times and deadlines are on the loop's clock, positions in the world frame.

    system_id: the vehicle's; None for the first vehicle that is received. start: its pose in the
    world on the ground; unless `set_anchor` is called, arming maps the position and heading of its
    estimator to this pose. earth: the origin for an estimator without GPS that has none; None for
    a vehicle with GPS. silence_s: how long nothing is received until the link counts as lost.
    max_clock_drift: see ClockMap. backend: None for our own frames. Errors are VehicleErrors.
    """

    def __init__(
        self,
        *,
        name: str,
        link: Link,
        autopilot: str = "auto",
        system_id: int | None = None,
        start: Pose = Pose((0.0, 0.0, 0.0)),  # noqa: B008 - frozen
        earth: LocalFrame | None = None,
        rates: TelemetryRates = TelemetryRates(),  # noqa: B008 - frozen
        own_system_id: int = 245,
        own_component: int = 190,
        silence_s: float = 1.5,
        max_clock_drift: float = 0.02,
        backend: CommandBackend | None = None,
    ) -> None:
        self.name = name
        self._backend: CommandBackend = backend or FrameBackend()
        self._link = self._backend.join(link)
        self._wanted = WantedVehicle(None if autopilot == "auto" else autopilot, system_id)
        self._start = start
        self._earth = earth
        gps_hz = min(_GROUND_SPEED_HZ, rates.position_hz)
        self._rates = replace(rates, ground_speed_hz=gps_hz)  # a fix that is lost is a fault
        self._anchor_given = False
        self._changes = ConditionWaiter()
        self._session = MavlinkSession(
            link=self._link,
            own=MavlinkTarget(own_system_id, own_component),
            sender=self._backend.sender,
        )
        self._link_monitor = LinkMonitor(
            session=self._session,
            silence_s=silence_s,
            on_lost=partial(self._on_link_change, up=False),
            on_back=partial(self._on_link_change, up=True),
        )
        self._commander = Commander(session=self._session, circumstances=self._circumstances)
        self._confirmed_command = ConfirmedCommand(
            name=name,
            changes=self._changes,
            state=lambda: self.state,
            heartbeat_s=lambda: (
                0.0 if self._status is None else self._status.reported_s.get("heartbeat", 0.0)
            ),
            circumstances=self._circumstances,
        )
        self.onboard = self._backend.onboard(
            session=self._session, circumstances=self._circumstances
        )
        self.parameters = self.onboard.parameters
        self.parameter_digest = ParameterDigest(session=self._session)
        self.clock = VehicleClock(own_id=own_system_id, max_drift=max_clock_drift)
        self._timesync = TimesyncRequester(session=self._session, clock=self.clock)
        self._estimates = Estimates(session=self._session, clock=self.clock)
        self._estimates.on_reboot = self._on_reboot
        self._estimates.on_unusable = self._report_unusable
        self.accuracy = EstimateAccuracy(session=self._session)
        self.truth = TruthReceiver(session=self._session, clock=self.clock)
        self._headings = HeadingMonitor(session=self._session, clock=self.clock)
        self._event_listeners: list[EventListener] = []
        self._status: StatusTracker | None = None
        self._vehicle: IdentifiedVehicle | None = None
        self._identified_s = math.inf
        self._has_armed = False
        """Whether it was commanded to arm: else somebody else armed it."""
        self._failure: VehicleError | None = None
        self._backend.on_failure(self._on_failure)

    async def __aenter__(self) -> Self:
        """Open the driver's link and start heartbeats. Raises LinkError."""
        await self._link.__aenter__()
        if not self._backend.sends_heartbeats:
            self._link_monitor.start()
        return self

    async def __aexit__(self, *raised: object) -> None:
        """Stop all sending and close the driver's link; it does not land the vehicle."""
        if self._vehicle is not None:
            self._vehicle.setpoints.stop()
            self._vehicle.streams.stop()
            self._vehicle.status.stop()
        self._link_monitor.stop()
        self._timesync.stop()
        self._commander.close()
        await self._link.__aexit__(*raised)

    @property
    def identity(self) -> VehicleIdentity:
        """Return the vehicle's identity. Raises VehicleError before `identify`."""
        return self._require_identified().identity

    @property
    def state(self) -> VehicleState:
        """Return the vehicle's last reported state, an immutable snapshot."""
        state = VehicleState() if self._status is None else self._status.state
        return state._replace(
            last_received_s=self._session.last_received_s,
            estimate=self._estimates.newest,
            local=self._estimates.local,
        )

    @property
    def others(self) -> tuple[str, ...]:
        """Return in words what else sends heartbeats with the vehicle's ids; they are ignored."""
        vehicle = self._vehicle
        return () if vehicle is None else tuple(map(vehicle.describe_other, self._session.others))

    @property
    def received_for_s(self) -> float:
        """Return for how long the vehicle has been identified, and its link listened to."""
        return asyncio.get_running_loop().time() - self._identified_s

    def request_version(self) -> None:
        """Request AUTOPILOT_VERSION again: a second vehicle answers by its own uid."""
        vehicle = self._require_identified()
        number = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
        self._session.send(vehicle.autopilot.request_message(vehicle.target, number))

    def require_alone(self) -> None:
        """Raise VehicleError when two vehicles with one system id arrive over the link."""
        found = self._session.second_vehicle.found
        if found:
            raise VehicleError(f"{self.name}: {self._describe_second(found)}; {RIVAL_REMEDY}")

    def take_arrivals(self) -> tuple[float, ...]:
        """Return the times (run clock) at which the vehicle was received since the last call.

        For one caller: each time is returned once. The times are thinned; a gap between them is
        at most 0.2 s longer than the vehicle's silence (`Arrivals`).
        """
        return self._session.arrivals.take()

    @property
    def reported_s(self) -> Mapping[ReportName, float]:
        """Return when each of the vehicle's reports last arrived (run clock)."""
        return {} if self._status is None else self._status.reported_s

    @property
    def estimate(self) -> EstimateSample | None:
        """Return the vehicle's newest estimate; None until it is anchored in the world."""
        return self._estimates.newest

    @property
    def place_deg(self) -> tuple[float, float] | None:
        """Return the vehicle's latitude and longitude by its estimate; None while unknown."""
        return self._estimates.place_deg

    def place_of(self, world_ned_m: Vec3) -> Geodetic:
        """Return the latitude and longitude of a world position by the vehicle's estimate.

        Raises AnchorError while it is not anchored, or knows no latitude and longitude.
        """
        return self._estimates.place_of(world_ned_m)

    @property
    def anchor(self) -> Anchor | None:
        """Return the anchor of the autopilot's local frame in the world; None while unknown."""
        return self._estimates.anchor

    def set_anchor(self, anchor: Anchor) -> None:
        """Set the driver's anchor (geodetic, motion capture) in place of the start pose."""
        self._anchor_given = True
        self._estimates.set_anchor(anchor)
        self._headings.anchor()

    def on_estimate(self, listener: EstimateListener) -> None:
        """Call `listener` with each estimate of the vehicle, once it is anchored."""
        self._estimates.listen(listener)

    def on_ground_speed(self, listener: Callable[[GroundSpeed], None]) -> None:
        """Call `listener` with speeds of the vehicle's GPS receiver; before `identify`."""
        self.onboard.gps_receiver.on_ground_speed(listener)

    def on_heading(self, listener: HeadingListener) -> None:
        """Call `listener` with comparisons of the vehicle's heading; before `identify`."""
        self._rates = replace(
            self._rates,
            accuracy_hz=_ACCURACY_HZ,  # ODOMETRY counts the estimator's resets
            magnetometer_hz=min(_MAGNETOMETER_HZ, self._rates.position_hz),
        )
        self._headings.listen(listener)

    def request_accuracy(self) -> None:
        """Request the covariance of the vehicle's estimator (`accuracy`); before `identify`."""
        self._rates = replace(self._rates, accuracy_hz=_ACCURACY_HZ)

    def on_truth(self, listener: TruthListener) -> None:
        """Call `listener` with the ground truth of the vehicle's simulator; before `identify`."""
        self._rates = replace(self._rates, truth_hz=self._rates.position_hz)
        self.truth.listen(listener)

    def on_message(self, message_id: int, handler: Handler) -> None:
        """Call `handler` with each of the vehicle's messages of a kind, and when it arrived."""
        self._session.on(message_id, handler)

    def request_missing(self) -> None:
        """Request again the vehicle's telemetry that does not arrive."""
        self._require_identified().streams.request_missing(asyncio.get_running_loop().time())

    def on_event(self, listener: EventListener) -> None:
        """Call `listener` with each event of the vehicle."""
        self._event_listeners.append(listener)

    def on_failure(self, listener: FailureListener) -> None:
        """Call `listener` once when the driver can no longer send; waits raise its error."""
        self._backend.on_failure(listener)

    async def identify(self, timeout_s: float) -> VehicleIdentity:
        """Find and identify the vehicle, and request its telemetry and time.

        Raises IdentifyError, which says what was received instead.
        """
        if self._vehicle is not None:
            return self._vehicle.identity
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + timeout_s
        vehicle, autopilot = await find_vehicle(
            self._session, self._changes, wanted=self._wanted, timeout_s=timeout_s
        )
        target = vehicle.target
        await self._backend.await_vehicle(target, max(deadline_s - loop.time(), _ANSWER_WITHIN_S))
        identity = await request_identity(
            self._session,
            self._changes,
            autopilot=autopilot,
            vehicle=vehicle,
            timeout_s=max(deadline_s - loop.time(), _ANSWER_WITHIN_S),
        )
        self.onboard.identified(autopilot, identity)
        self._status = status = StatusTracker(
            session=self._session,
            autopilot=autopilot,
            changes=self._changes,
            listeners=self._event_listeners,
        )
        first = self._session.heartbeats[vehicle]
        status.heartbeat(first.heartbeat, first.t_s)
        plan = autopilot.telemetry_plan(self._rates)
        self.truth.begin(autopilot)
        self._vehicle = IdentifiedVehicle(
            identity=identity,
            autopilot=autopilot,
            target=target,
            status=status,
            commands=self._backend.commands(
                commander=self._commander, autopilot=autopilot, target=target
            ),
            streams=TelemetryStreams(
                session=self._session, autopilot=autopilot, target=target, plan=plan
            ),
            setpoints=SetpointSender(
                session=self._session, clock=self.clock, autopilot=autopilot, target=target
            ),
            estimates=self._estimates,
            clock=self.clock,
            earth=self._earth,
        )
        for kind, t_s in self._session.others.items():
            self._report_other(kind, t_s)
        self._session.on_other = self._report_other
        second = self._session.second_vehicle
        second.position_hz = self._rates.position_hz
        second.on_found = self._report_second
        self._identified_s = loop.time()
        self._begin_listening()
        self.parameter_digest.begin(autopilot, target)
        return identity

    async def ready(self, timeout_s: float) -> None:
        """Wait until the vehicle can arm and take off, and anchor it at its start pose.

        One that is armed is another's. Raises NotReadyError with the reasons and the last
        STATUSTEXTs, and VehicleError when a second vehicle has its system id.
        """
        vehicle = self._require_identified()
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + timeout_s
        vehicle.streams.watch()
        while True:
            self.require_alone()
            slice_s = max(0.0, min(_REQUEST_AGAIN_S, deadline_s - loop.time()))
            if await self._changes.until(self._is_ready_or_two, slice_s):
                self.require_alone()
                break
            if loop.time() >= deadline_s:
                what = f"{self.name}: not ready to arm within {timeout_s:g} s"
                reasons = (*self._armed_reason(), *self._reasons())
                raise not_ready_error(vehicle, what, reasons, self._circumstances())
            for message in vehicle.messages_to_get_ready():
                self._session.send(message)
        vehicle.streams.watch(only_known=True)
        self._capture_anchor()

    async def arm(self) -> None:
        """Anchor the vehicle, set the mode to arm in, arm, and see it armed.

        Raises ArmRefusedError with the autopilot's reasons, AnchorError, StateTimeoutError, and
        VehicleError when a second vehicle has its system id, or somebody else has armed it.
        """
        vehicle = self._require_identified()
        self.require_alone()
        for reason in self._armed_reason():
            raise VehicleError(f"{self.name}: {reason}")
        self._has_armed = True
        status, autopilot = vehicle.status, vehicle.autopilot
        if self._reasons():
            vehicle.streams.request()
        # On a bad link the last second may hold too few positions to anchor it by.
        await self._changes.until(lambda: not self._reasons(), SEEN_WITHIN_S)
        self._capture_anchor()
        if status.state.mode is not autopilot.arming_mode:
            await self._set_mode(autopilot.arming_mode)
        try:
            await self._confirmed_command.confirm(
                vehicle.commands.arm, lambda: status.state.armed, "armed"
            )
        except CommandError as error:
            raise await arm_refused_error(vehicle, self.name, self._changes, error) from error

    async def disarm(self) -> None:
        """Disarm the vehicle on the ground. Raises CommandError when refused (in the air)."""
        vehicle = self._require_identified()
        status = vehicle.status
        await self._confirmed_command.confirm(
            vehicle.commands.disarm, lambda: not status.state.armed, "disarmed"
        )

    def begin_takeoff(self, altitude_m: float) -> Awaitable[None]:
        """Send the vehicle's takeoff command now; await the result for its acceptance.

        altitude_m: above the ground below it. The frame is written before this returns, so that
        two vehicles get their commands in one turn of the loop. Awaiting raises CommandError.
        """
        vehicle = self._require_identified()
        status = vehicle.status
        status.requested_modes = vehicle.autopilot.takeoff_modes
        flies = {"taking_off", "in_air"}
        return vehicle.commands.begin_takeoff(
            altitude_m,
            ground_amsl_m=self._estimates.amsl_m,
            done=lambda: status.state.landed in flies,
        )

    async def enter_guided(self) -> None:
        """Set the vehicle's mode that follows setpoints; it holds until the first `send`.

        Where the autopilot wants a stream of setpoints (PX4), zero velocity is streamed until
        then. Raises CommandError, StateTimeoutError.
        """
        vehicle = self._require_identified()
        if vehicle.autopilot.streams_before_guided_s > 0:
            vehicle.setpoints.keep_still()
            await asyncio.sleep(vehicle.autopilot.streams_before_guided_s)
        if vehicle.status.state.mode is not FlightMode.GUIDED:
            await self._set_mode(FlightMode.GUIDED)

    def send(self, setpoint: Setpoint) -> None:
        """Send the vehicle a setpoint (world frame); the caller renews it within the time-out.

        Raises AnchorError before `ready`, and the error that `on_failure` reports.
        """
        if self._failure is not None:
            raise self._failure
        anchor = self._estimates.anchor
        if anchor is None:
            raise AnchorError(f"{self.name}: not anchored in the world; await ready() first")
        self._require_identified().setpoints.send(anchor.to_local(setpoint))

    def keep_still(self) -> None:
        """Stream zero velocity to the vehicle until the next `send` or `hand_over`."""
        self._require_identified().setpoints.keep_still()

    def hand_over(self) -> None:
        """Stop the driver's setpoints: another program sends them."""
        self._require_identified().setpoints.stop()

    def send_message(self, message: Any) -> None:
        """Send the vehicle a MAVLink message, such as a sensor's."""
        self._session.send(message)

    async def hold(self) -> None:
        """Hold position and ignore setpoints. Raises CommandError, StateTimeoutError."""
        await self._set_mode(FlightMode.HOLD)

    async def land(self) -> None:
        """Start the vehicle's landing; see `disarmed`. Raises CommandError, StateTimeoutError."""
        await self._set_mode(FlightMode.LAND)

    async def terminate(self) -> None:
        """Stop the vehicle's motors at once, in the air too. Raises CommandError."""
        vehicle = self._require_identified()
        vehicle.setpoints.stop()
        await vehicle.commands.terminate()

    async def disarmed(self, timeout_s: float) -> None:
        """Wait until the vehicle is disarmed. Raises StateTimeoutError.

        One that stays armed on the ground, as with PX4's COM_DISARM_LAND of -1, is commanded to
        disarm.
        """
        status = self._require_identified().status
        async with open_task_group() as tasks:
            disarming = tasks.create_task(
                self._disarm_on_ground(timeout_s), name=f"disarming {self.name}"
            )
            await self._confirmed_command.await_effect(
                lambda: not status.state.armed, timeout_s, "disarmed"
            )
            await stop_tasks(disarming)

    async def _disarm_on_ground(self, within_s: float) -> None:
        """Command disarming, again and again, while the vehicle stays armed on the ground."""
        status = self._require_identified().status

        def has_landed() -> bool:
            return status.state.landed == "on_ground"

        while await self._changes.until(has_landed, within_s):
            if not await self._changes.until(lambda: not has_landed(), _DISARMS_ITSELF_S):
                with suppress(CommandError, StateTimeoutError):
                    await self.disarm()

    def _require_identified(self) -> IdentifiedVehicle:
        if self._vehicle is None:
            raise VehicleError(f"{self.name}: not identified yet; await identify() first")
        return self._vehicle

    async def _set_mode(self, mode: FlightMode) -> None:
        vehicle = self._require_identified()
        status = vehicle.status
        status.requested_modes = (mode,)
        await self._confirmed_command.confirm(
            partial(vehicle.commands.set_mode, mode),
            lambda: status.state.mode is mode,
            f"in {mode.value}",
        )
        if mode is not FlightMode.GUIDED:
            vehicle.setpoints.stop()

    def _capture_anchor(self) -> None:
        if not self._anchor_given:
            try:
                self._estimates.anchor_at(self._start)
                self.truth.anchor_at(self._start)
                self._headings.anchor()
            except AnchorError as error:
                raise AnchorError(f"{self.name}: {error}") from error

    def _is_ready_or_two(self) -> bool:
        is_ready = not self._armed_reason() and not self._reasons()
        return is_ready or bool(self._session.second_vehicle.found)

    def _armed_reason(self) -> tuple[str, ...]:
        armed = self._require_identified().status.state.armed and not self._has_armed
        return ("it is armed already, by somebody else; land and disarm it first",) if armed else ()

    def _reasons(self) -> tuple[str, ...]:
        return self._require_identified().reasons(self._rates.position_hz)

    def _circumstances(self) -> str:
        """Return the link's and vehicle's circumstances for an error message; or empty."""
        texts = () if self._status is None else self._status.last_texts()
        last_texts = "its last STATUSTEXT: " + " | ".join(texts) if texts else ""
        return "".join(f"; {text}" for text in (self._link_monitor.silence(), last_texts) if text)

    def _begin_listening(self) -> None:
        streams = self._require_identified().streams
        streams.request()
        streams.watch()
        self._timesync.start()
        self._link_monitor.watch()

    def _report_other(self, kind: HeartbeatKind, t_s: float) -> None:
        vehicle = self._require_identified()
        vehicle.status.report(VehicleEvent(t_s, "other_sender", vehicle.describe_other(kind)))

    def _report_unusable(self, why: str, t_s: float) -> None:
        if self._status is not None:
            self._status.report(VehicleEvent(t_s, "unusable_estimate", why))

    def _describe_second(self, found: str) -> str:
        system = self._require_identified().target.system
        return f"two vehicles have the system id {system} on this link: {found}"

    def _report_second(self, found: str, t_s: float) -> None:
        text = self._describe_second(found)
        self._require_identified().status.report(VehicleEvent(t_s, "second_vehicle", text))
        self._changes.notify()

    def _on_reboot(self, t_s: float) -> None:
        self.truth.restart()
        self._headings.restart()
        if self._vehicle is not None:
            self._vehicle.status.rebooted(t_s)
            self._begin_listening()

    def _on_failure(self, error: VehicleError) -> None:
        self._failure = error
        if self._vehicle is not None:
            self._vehicle.setpoints.stop()
        # The vehicle's parameters, fence and missions still have to be restored.
        self._session.write_frames()
        self._changes.fail(error)
        self._commander.fail(error)

    def _on_link_change(self, t_s: float, gap_s: float, *, up: bool) -> None:
        if self._status is not None:
            self._status.set_link(up=up, t_s=t_s, gap_s=gap_s)
