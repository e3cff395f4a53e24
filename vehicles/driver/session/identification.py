"""Finds the vehicle on a link by its heartbeats, and requests its AUTOPILOT_VERSION."""

import asyncio
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.autopilots.autopilot import Autopilot, Target
from vehicles.driver.session.conditions import ConditionWaiter
from vehicles.driver.session.identity import (
    Identity,
    Wanted,
    describe_mismatches,
    identity_of,
    matching_vehicle,
    unsupported_version,
)
from vehicles.driver.session.session import Session
from vehicles.errors import IdentifyError
from vehicles.links.link import TellsTrouble

_REQUEST_AGAIN_S = 0.5
_LATE_S = 0.5
"""From this delay of our own on, it may explain a missing answer, rather than the vehicle."""


async def find_vehicle(
    session: Session, changes: ConditionWaiter, *, wanted: Wanted, timeout_s: float
) -> tuple[Target, Autopilot]:
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
    session: Session,
    changes: ConditionWaiter,
    *,
    autopilot: Autopilot,
    target: Target,
    timeout_s: float,
) -> Identity:
    """Request the vehicle's AUTOPILOT_VERSION and return its identity.

    From then on the session receives this vehicle only. Raises IdentifyError when it does not
    answer.
    """
    answers: list[Any] = []
    loop = asyncio.get_running_loop()
    own_delay_s = 0.0

    def take(message: Any, _t_s: float) -> None:
        answers.append(message)
        changes.notify()

    def note_delay(_message: Any, arrived_s: float) -> None:
        nonlocal own_delay_s
        own_delay_s = max(own_delay_s, loop.time() - arrived_s)

    deadline_s = loop.time() + timeout_s
    session.target = target
    session.on(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, take)
    session.on(mavlink.MAVLINK_MSG_ID_HEARTBEAT, note_delay)
    try:
        while not answers and (left_s := deadline_s - loop.time()) > 0:
            session.send(
                autopilot.request_message(target, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
            )
            due_s = loop.time() + min(_REQUEST_AGAIN_S, left_s)
            await changes.until(lambda: bool(answers), min(_REQUEST_AGAIN_S, left_s))
            own_delay_s = max(own_delay_s, loop.time() - due_s)
    finally:
        session.off(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, take)
        session.off(mavlink.MAVLINK_MSG_ID_HEARTBEAT, note_delay)
    if not answers:
        session.target = None
        raise IdentifyError(_unanswered_text(session, autopilot, target, own_delay_s))
    identity = identity_of(autopilot, target, session.heartbeats[target], answers[0])
    if fault := unsupported_version(identity):
        session.target = None
        raise IdentifyError(f"{session.link.name}: {fault}")
    return identity


def _unanswered_text(
    session: Session, autopilot: Autopilot, target: Target, own_delay_s: float
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


def _received_text(session: Session, wanted: Wanted, timeout_s: float) -> str:
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
