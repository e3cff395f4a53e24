"""How a driver asks for telemetry: all of it in one packet, so that it comes in few."""

from typing import Any, Self

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.autopilots.autopilot import Target, TelemetryRates
from vehicles.autopilots.px4 import Px4
from vehicles.driver.session.session import Session
from vehicles.driver.telemetry_streams import TelemetryStreams
from vehicles.links.link import Receiver
from vehicles.mavlink.codec import Codec


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
    found: list[Any] = Codec(system_id=1, component_id=1).parse(b"".join(packets))
    return [one.param1 for one in found if one.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL]


def test_all_streams_are_asked_for_in_one_packet() -> None:
    wire, plan = Wire(), Px4().telemetry_plan(TelemetryRates())
    session = Session(link=wire, own=Target(245, 190))
    TelemetryStreams(session=session, autopilot=Px4(), target=Target(1), plan=plan).request()
    assert len(wire.packets) == 1
    assert asked(wire.packets) == [line.message_id for line in plan]


def test_another_command_backend_says_each_of_them() -> None:
    wire, said = Wire(), list[Any]()
    plan = Px4().telemetry_plan(TelemetryRates())
    session = Session(link=wire, own=Target(245, 190), sender=said.append)
    streams = TelemetryStreams(session=session, autopilot=Px4(), target=Target(1), plan=plan)
    streams.request()
    assert [one.param1 for one in said] == [line.message_id for line in plan]
    session.write_frames()
    streams.request()
    assert len(wire.packets) == 1
