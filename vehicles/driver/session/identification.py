"""Finds the vehicle on a link by its heartbeats, and requests its AUTOPILOT_VERSION."""

import asyncio
from typing import Any, Self

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.autopilot import Autopilot, MavlinkTarget, has_board_ids
from wil_campaign.vehicles.driver.session.conditions import ConditionWaiter
from wil_campaign.vehicles.driver.session.identity import (
    VehicleIdentity,
    WantedVehicle,
    describe_mismatches,
    identity_of,
    matching_vehicle,
    unsupported_version,
)
from wil_campaign.vehicles.driver.session.session import Handler, HeartbeatSender, MavlinkSession
from wil_campaign.vehicles.errors import IdentifyError
from wil_campaign.vehicles.links.link import TellsTrouble

_REQUEST_AGAIN_S = 0.5
_SIMULATION_S = 2.0
"""How long after its version an autopilot that names no board may take to show a simulation."""
_LATE_S = 0.5
"""From this delay of our own on, it may explain a missing answer, rather than the vehicle."""


async def find_vehicle(
    session: MavlinkSession, changes: ConditionWaiter, *, wanted: WantedVehicle, timeout_s: float
) -> tuple[HeartbeatSender, Autopilot]:
    """Find the first vehicle on the link that we can fly; return it with its strategy.

    Raises IdentifyError when none was received in time, with what was received instead.
    """

    def note(_message: Any, _t_s: float) -> None:
        changes.notify()

    session.on(mavlink.MAVLINK_MSG_ID_HEARTBEAT, note)
    try:
        await changes.until(
            lambda: matching_vehicle(session.heartbeats, wanted) is not None, timeout_s
        )
    finally:
        session.off(mavlink.MAVLINK_MSG_ID_HEARTBEAT, note)
    vehicle = matching_vehicle(session.heartbeats, wanted)
    if vehicle is None:
        raise IdentifyError(_received_text(session, wanted, timeout_s))
    return vehicle


async def request_identity(
    session: MavlinkSession,
    changes: ConditionWaiter,
    *,
    autopilot: Autopilot,
    vehicle: HeartbeatSender,
    timeout_s: float,
) -> VehicleIdentity:
    """Request the vehicle's AUTOPILOT_VERSION and return its identity.

    Of an autopilot that names no board it is also requested what only its simulation sends. From
    then on the session receives this vehicle only. Raises IdentifyError when it does not answer.
    """
    loop = asyncio.get_running_loop()
    deadline_s = loop.time() + timeout_s
    target = vehicle.target
    session.select(vehicle)
    with _Answers(session, changes, autopilot) as answers:
        while not answers.complete and (left_s := deadline_s - loop.time()) > 0:
            for message_id in answers.missing:
                session.send(autopilot.request_message(target, message_id))
            due_s = loop.time() + min(_REQUEST_AGAIN_S, left_s)
            await changes.until(lambda: answers.complete, min(_REQUEST_AGAIN_S, left_s))
            answers.own_delay_s = max(answers.own_delay_s, loop.time() - due_s)
            if answers.version is not None:
                deadline_s = min(deadline_s, answers.version_s + _SIMULATION_S)
    if answers.version is None:
        session.select(None)
        raise IdentifyError(_unanswered_text(session, autopilot, target, answers.own_delay_s))
    identity = identity_of(
        autopilot,
        target,
        session.heartbeats[vehicle],
        answers.version,
        is_simulated=answers.is_simulated,
    )
    if fault := unsupported_version(identity):
        session.select(None)
        raise IdentifyError(f"{session.link.name}: {fault}")
    return identity


class _Answers:
    """A vehicle's answers to the requests for its identity; a context manager that receives them.

    own_delay_s: the longest delay of this program in reading or resuming.
    """

    def __init__(
        self, session: MavlinkSession, changes: ConditionWaiter, autopilot: Autopilot
    ) -> None:
        self._session = session
        self._changes = changes
        self._sign_id = autopilot.simulation_message_id
        self.version: Any | None = None
        self.version_s = 0.0
        self.is_simulated = False
        """Whether it has sent what only a simulation sends."""
        self.own_delay_s = 0.0

    def __enter__(self) -> Self:
        """Begin to receive the vehicle's answers."""
        for message_id, handler in self._handlers():
            self._session.on(message_id, handler)
        return self

    def __exit__(self, *_: object) -> None:
        """Stop to receive the vehicle's answers."""
        for message_id, handler in self._handlers():
            self._session.off(message_id, handler)

    @property
    def complete(self) -> bool:
        """Return whether the answers tell the vehicle's identity."""
        if self.version is None:
            return False
        return self._sign_id is None or self.is_simulated or has_board_ids(self.version)

    @property
    def missing(self) -> tuple[int, ...]:
        """Return the ids of the messages that are not answered yet."""
        version = () if self.version is not None else (mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION,)
        sign = () if self._sign_id is None or self.is_simulated else (self._sign_id,)
        return version + sign

    def _handlers(self) -> list[tuple[int, Handler]]:
        handlers: list[tuple[int, Handler]] = [
            (mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, self._receive_version),
            (mavlink.MAVLINK_MSG_ID_HEARTBEAT, self._note_delay),
        ]
        sign = [] if self._sign_id is None else [(self._sign_id, self._receive_sign)]
        return handlers + sign

    def _receive_version(self, message: Any, t_s: float) -> None:
        self.version, self.version_s = message, t_s
        self._changes.notify()

    def _receive_sign(self, _message: Any, _t_s: float) -> None:
        self.is_simulated = True
        self._changes.notify()

    def _note_delay(self, _message: Any, arrived_s: float) -> None:
        delay_s = asyncio.get_running_loop().time() - arrived_s
        self.own_delay_s = max(self.own_delay_s, delay_s)


def _unanswered_text(
    session: MavlinkSession, autopilot: Autopilot, target: MavlinkTarget, own_delay_s: float
) -> str:
    """Return in words that a vehicle did not answer, and the likely cause.

    own_delay_s: the longest delay of this program in reading or resuming.
    """
    what = (
        f"{session.link.name}: {autopilot.label}, system {target.system}, sends heartbeats but "
        "does not answer our requests"
    )
    if own_delay_s >= _LATE_S:
        return (
            f"{what}; this program itself was {own_delay_s:.1f} s late: the machine is overloaded, "
            "or the requested pace (times real time) is too high for it"
        )
    return f"{what}; is its link one-way, or does a router drop our system id {session.own.system}?"


def _received_text(session: MavlinkSession, wanted: WantedVehicle, timeout_s: float) -> str:
    """Return in words what was received during a failed identification."""
    name, codec = session.link.name, session.codec
    awaited = f"{name}: no {wanted} within {timeout_s:g} s: "
    if session.heartbeats:
        return awaited + describe_mismatches(session.heartbeats, wanted)
    if codec.bytes_seen == 0:
        trouble = session.link.trouble if isinstance(session.link, TellsTrouble) else ""
        reason = f" ({trouble})" if trouble else ""
        return (
            f"{awaited}nothing arrived{reason}; check that the vehicle runs and that it sends to "
            "this address and port"
        )
    if codec.garbage_bytes >= codec.bytes_seen / 2:
        return (
            f"{awaited}{codec.bytes_seen} bytes arrived, and they are not MAVLink; wrong port or "
            "wrong baud rate?"
        )
    return f"{awaited}MAVLink arrives, but no heartbeat; is the autopilot still starting?"
