"""How a driver asks for telemetry: all of it in one packet, so that it comes in few."""

import asyncio
from typing import Any, Self

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget, MessageRate, TelemetryRates
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.driver.telemetry_streams import TelemetryStreams
from wil_campaign.vehicles.links.link import Receiver
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec


class Wire:
    """The driver's end of a link; keeps what is written."""

    name = "wire"

    def __init__(self) -> None:
        self.packets: list[bytes] = []

    def receive(self, receiver: Receiver) -> None:
        """Nothing comes."""

    def write(self, data: bytes) -> None:
        self.packets.append(data)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        """Nothing to close."""


def asked(packets: list[bytes]) -> list[float]:
    """Return the ids of the messages that were asked for."""
    found: list[Any] = MavlinkCodec(system_id=1, component_id=1).parse(b"".join(packets))
    return [one.param1 for one in found if one.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL]


def test_all_streams_are_asked_for_in_one_packet() -> None:
    wire, plan = Wire(), Px4().telemetry_plan(TelemetryRates())
    session = MavlinkSession(link=wire, own=MavlinkTarget(245, 190))
    TelemetryStreams(session=session, autopilot=Px4(), target=MavlinkTarget(1), plan=plan).request()
    assert len(wire.packets) == 1
    assert asked(wire.packets) == [line.message_id for line in plan]


def test_another_command_backend_sends_each_stream_request() -> None:
    wire, said = Wire(), list[Any]()
    plan = Px4().telemetry_plan(TelemetryRates())
    session = MavlinkSession(link=wire, own=MavlinkTarget(245, 190), sender=said.append)
    streams = TelemetryStreams(session=session, autopilot=Px4(), target=MavlinkTarget(1), plan=plan)
    streams.request()
    assert [one.param1 for one in said] == [line.message_id for line in plan]
    session.write_frames()
    streams.request()
    assert len(wire.packets) == 1


POSITION = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
VEHICLE = MavlinkCodec(system_id=1, component_id=1)


def streams_of(*plan: MessageRate) -> tuple[TelemetryStreams, MavlinkSession, Wire]:
    """Return the streams of a plan, of a vehicle that is identified."""
    wire = Wire()
    session = MavlinkSession(link=wire, own=MavlinkTarget(245, 190))
    session.target = MavlinkTarget(1)
    streams = TelemetryStreams(session=session, autopilot=Px4(), target=MavlinkTarget(1), plan=plan)
    return streams, session, wire


async def say_positions(session: MavlinkSession, rate_hz: float, for_s: float) -> None:
    for _ in range(round(rate_hz * for_s)):
        message = mavlink.MAVLink_local_position_ned_message(0, *[0.0] * 6)
        session.received(VEHICLE.pack(message), asyncio.get_running_loop().time())
        await asyncio.sleep(1.0 / rate_hz)


def test_in_flight_no_stream_is_asked_for_that_has_never_come() -> None:
    """A vehicle without GPS has no global position, however often it is asked for."""

    async def scenario() -> list[float]:
        streams, session, wire = streams_of(MessageRate(POSITION, 50.0), MessageRate(33, 5.0))
        streams.watch()
        await say_positions(session, 50.0, 5.0)
        before = asked(wire.packets)
        wire.packets.clear()
        streams.watch(only_known=True)
        await say_positions(session, 50.0, 5.0)
        streams.stop()
        return [*before, -1.0, *asked(wire.packets)]

    assert run_virtual(scenario()) == [33.0, 33.0, -1.0]


def test_a_stream_is_asked_for_again_only_while_it_is_too_slow() -> None:
    """A ground station's REQUEST_DATA_STREAM cuts an ArduPilot's positions to 3 Hz in flight."""

    async def scenario() -> list[int]:
        streams, session, wire = streams_of(MessageRate(POSITION, 50.0))
        streams.request()
        streams.watch()
        counts = []
        for rate_hz in (50.0, 3.0, 50.0):
            await say_positions(session, rate_hz, 10.0)
            counts.append(len(asked(wire.packets)))
            wire.packets.clear()
        streams.stop()
        await asyncio.sleep(10.0)
        return [*counts, len(wire.packets)]

    in_time, slow, again, stopped = run_virtual(scenario())
    assert in_time == 1
    assert 3 <= slow <= 5, "every 2 s"
    assert again <= 1
    assert stopped == 0
