"""A vehicle with two radios: one falls silent in flight, and the flight goes on by the other."""

import asyncio
from functools import partial
from typing import Any, Self

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.impaired_links.impaired import ImpairedLink, Radio
from wil_campaign.plugins.impaired_links.impairment import Impairment
from wil_campaign.plugins.redundant_links.redundant import SILENT_S, STEADY_S, RedundantLink
from wil_campaign.plugins.stream_links.tcp import TcpInLink
from wil_campaign.vehicles.autopilots.autopilot import FlightMode, MavlinkTarget, command_long
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.vehicle_state import VehicleEvent
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.links.link import Link, LinkError, Receiver
from wil_campaign.vehicles.links.link_conditions import (
    LinkConditions,
    LinkSite,
    link_under_conditions,
)
from wil_campaign.vehicles.links.link_strings import LinkAddress
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.setpoints import VelocitySetpoint

OURS = MavlinkCodec(system_id=245, component_id=190)
VEHICLE = MavlinkCodec(system_id=1, component_id=1)
BEAT = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3)
HEARTBEAT = VEHICLE.pack(BEAT)
OTHER_VEHICLES = MavlinkCodec(system_id=2, component_id=1).pack(BEAT)


def _collect(box: list[Any], reader: MavlinkCodec, data: bytes, _: object) -> None:
    box.extend(reader.parse(data))


class TwoRadios:
    """The vehicle's end: what it says goes out by both, what comes by either is heard."""

    def __init__(self, radios: list[Link]) -> None:
        self._radios = radios
        self.name = "two radios"

    def receive(self, receiver: Receiver) -> None:
        for radio in self._radios:
            radio.receive(receiver)

    def write(self, data: bytes) -> None:
        for radio in self._radios:
            radio.write(data)

    async def __aenter__(self) -> Self:
        for radio in self._radios:
            await radio.__aenter__()
        return self

    async def __aexit__(self, *raised: object) -> None:
        for radio in self._radios:
            await radio.__aexit__(*raised)


class Ends:
    """A redundant link in memory, what it told and handed on, and what its far ends heard."""

    def __init__(self) -> None:
        pairs = [memory_pair(name=name) for name in ("one", "two")]
        self.told: list[str] = []
        self.heard: list[bytes] = []
        self.sent: list[list[Any]] = [[], []]
        self.link = RedundantLink(
            links=[ours for ours, _ in pairs], system_id=1, on_switch=self.told.append
        )
        self.link.receive(lambda data, _: self.heard.append(data))
        self.far = [far for _, far in pairs]
        for far, box in zip(self.far, self.sent, strict=True):
            reader = MavlinkCodec(system_id=1, component_id=1)
            far.receive(partial(_collect, box, reader))

    async def __aenter__(self) -> Self:
        for one in (self.link, *self.far):
            await one.__aenter__()
        return self

    async def __aexit__(self, *error: object) -> None:
        for one in (self.link, *self.far):
            await one.__aexit__(None, None, None)

    async def speak(self, *numbers: int, for_s: float, other: int | None = None) -> None:
        """Have the vehicle heard by these links, ten times a second; another one by `other`."""
        for _ in range(round(for_s * 10)):
            for number in numbers:
                self.far[number].write(HEARTBEAT)
            if other is not None:
                self.far[other].write(OTHER_VEHICLES)
            await asyncio.sleep(0.1)


def test_the_first_is_flown_by_until_it_is_silent_and_again_when_it_is_steady() -> None:
    async def scenario() -> None:
        async with Ends() as ends:
            await ends.speak(0, 1, for_s=3.0)
            assert ends.link.active == 0
            assert len(ends.heard) == 30
            await ends.speak(1, for_s=SILENT_S - 0.1)
            assert (ends.link.active, len(ends.heard)) == (0, 30)
            await ends.speak(1, for_s=1.2)
            assert ends.link.active == 1
            assert len(ends.heard) > 35
            await ends.speak(0, 1, for_s=STEADY_S - 1.0)
            assert ends.link.active == 1
            await ends.speak(0, 1, for_s=2.0)
            assert ends.link.active == 0
        assert ends.told == [
            "one:a is silent for 0.3 s; switched to two:a",
            "one:a receives again without a gap; switched to one:a",
        ]

    run_virtual(scenario())


def test_a_link_that_flaps_is_not_gone_back_to() -> None:
    async def scenario() -> None:
        async with Ends() as ends:
            await ends.speak(1, for_s=2.0)
            for _ in range(10):
                await ends.speak(0, 1, for_s=2.0)
                await ends.speak(1, for_s=1.0)
            assert (ends.link.active, len(ends.told)) == (1, 1)

    run_virtual(scenario())


def test_noise_is_no_sign_of_life_of_a_spare_and_is_reported_of_the_first() -> None:
    async def scenario() -> None:
        async with Ends() as ends:
            for _ in range(30):
                ends.far[0].write(b"\xff" * 20)
                ends.far[1].write(b"\xee" * 20)
                await asyncio.sleep(0.1)
            assert ends.link.active == 0
            assert set(ends.heard) == {b"\xff" * 20}

    run_virtual(scenario())


def test_another_vehicle_is_no_sign_of_life_of_this_one() -> None:
    """Two vehicles on one radio network: one of them is no longer received by it."""

    async def scenario() -> None:
        async with Ends() as ends:
            await ends.speak(0, 1, for_s=1.0)
            await ends.speak(1, for_s=1.0, other=0)
            assert ends.link.active == 1
            await ends.speak(1, for_s=STEADY_S + 1.0, other=0)
            assert ends.link.active == 1

    run_virtual(scenario())


def test_an_abort_goes_by_every_link_and_a_transaction_by_one() -> None:
    async def scenario() -> None:
        target = MavlinkTarget(1)
        twice = [
            mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3),
            command_long(target, mavlink.MAV_CMD_DO_SET_MODE, 1.0),
            command_long(target, mavlink.MAV_CMD_NAV_LAND),
            command_long(target, mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0),
            command_long(target, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 32.0, 2e4),
        ]
        once = [
            mavlink.MAVLink_mission_count_message(1, 1, 4),
            mavlink.MAVLink_param_request_list_message(1, 1),
            command_long(target, mavlink.MAV_CMD_NAV_TAKEOFF),
            # Trailing zeros are not sent: the command's number may be among them.
            command_long(target, 0),
        ]
        async with Ends() as ends:
            ends.link.write(b"".join(OURS.pack(message) for message in twice + once))
            await asyncio.sleep(0.1)
            first, second = (list(map(str, box)) for box in ends.sent)
            assert first == list(map(str, twice + once))
            assert second == list(map(str, twice))
            await ends.speak(1, for_s=1.0)
            del ends.sent[1][:]
            ends.link.write(b"".join(OURS.pack(message) for message in once))
            await asyncio.sleep(0.1)
            assert list(map(str, ends.sent[1])) == list(map(str, once))

    run_virtual(scenario())


def test_rates_are_asked_for_again_by_the_link_that_takes_over() -> None:
    async def scenario() -> None:
        rates = [
            command_long(MavlinkTarget(1), mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, us)
            for number, us in ((32.0, 1e5), (31.0, 2e4), (32.0, 2e4))
        ]
        async with Ends() as ends:
            ends.link.write(b"".join(OURS.pack(message) for message in rates))
            await ends.speak(0, for_s=1.0)
            del ends.sent[1][:]
            await ends.speak(1, for_s=1.0)
            asked = [(each.param1, each.param2) for each in ends.sent[1]]
            assert asked == [(32.0, pytest.approx(2e4)), (31.0, pytest.approx(2e4))]

    run_virtual(scenario())


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_the_first_radio_dies_in_flight(autopilot: str) -> None:
    async def scenario() -> None:
        (one, far_one), (two, far_two) = (memory_pair(latency_s=0.003) for _ in range(2))
        told: list[str] = []
        events: list[VehicleEvent] = []
        lossy = Impairment(loss=0.05)
        conditions = LinkConditions(air=(Radio(outgoing=lossy, incoming=lossy, seed=(0,)),))
        site = LinkSite(system_id=1, on_switch=told.append)
        both = link_under_conditions([one, two], conditions, utc_s=0.0, site=site)
        config = EmbeddedConfig(autopilot=autopilot, running_s=60.0)
        async with (
            EmbeddedVehicle(config=config, link=TwoRadios([far_one, far_two]), seed=1) as vehicle,
            Driver(name="real", link=both.link) as driver,
        ):
            driver.on_event(events.append)
            await driver.identify(5.0)
            await driver.ready(60.0)
            await driver.arm()
            await driver.begin_takeoff(2.0)
            await asyncio.sleep(6.0)
            await driver.enter_guided()
            assert isinstance(both.impaired, ImpairedLink)
            both.impaired.start_outage(300.0)
            for _ in range(100):
                driver.send(VelocitySetpoint((0.5, 0.0, 0.0)))
                await asyncio.sleep(0.05)
            assert driver.state.mode is FlightMode.GUIDED
            assert await driver.parameters.get(
                "COM_OF_LOSS_T" if autopilot == "px4" else "GUID_TIMEOUT"
            )
            await driver.hold()
            await driver.land()
            await driver.disarmed(40.0)
        assert vehicle.truth().pose.position_ned_m[0] > 1.5
        assert len(told) == 1
        assert {event.kind for event in events}.isdisjoint({"link_lost", "failsafe"})

    run_virtual(scenario())


async def test_a_link_that_cannot_be_opened_closes_the_others(free_tcp_port: int) -> None:
    address = LinkAddress("tcpin", host="127.0.0.1", port=free_tcp_port)
    with pytest.raises(LinkError, match="is in use"):
        await RedundantLink(
            links=[TcpInLink(address=address), TcpInLink(address=address)], system_id=1
        ).__aenter__()
    async with TcpInLink(address=address):
        pass
    with pytest.raises(ValueError, match="needs two links"):
        RedundantLink(links=[TcpInLink(address=address)], system_id=1)
