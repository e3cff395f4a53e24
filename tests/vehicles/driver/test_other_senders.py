"""Somebody else with the vehicle's ids: a companion computer's program, another autopilot."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.vehicle_state import VehicleEvent
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import FrameSplitter
from wil_campaign.vehicles.mavlink.heartbeats import HeartbeatKind, heartbeat_kind

COMPANION = (mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID)
KINDS = [
    COMPANION,
    (mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID),
    (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4),
]


class Other:
    """Sends heartbeats with the ids of a peer, once a second."""

    def __init__(self, peer: Any, kind: tuple[int, int]) -> None:
        self._peer = peer
        self._beat = mavlink.MAVLink_heartbeat_message(*kind, 0, 0, 4, 3)
        self._codec = MavlinkCodec(system_id=1, component_id=1)

    def send(self) -> None:
        self._peer.link.write(self._codec.pack(self._beat))

    async def run(self) -> None:
        while True:
            self.send()
            await asyncio.sleep(0.5)


def flown(
    fake_pair: Callable[..., Any], kind: tuple[int, int], script: Callable[..., Any]
) -> list[VehicleEvent]:
    """Arm an ArduCopter beside another sender, from the first moment on or later."""

    async def fly() -> list[VehicleEvent]:
        link, peer = fake_pair("ardupilot")
        events: list[VehicleEvent] = []
        async with peer, Driver(name="real", link=link, autopilot="ardupilot") as driver:
            driver.on_event(events.append)
            await script(driver, peer, Other(peer, kind))
        return events

    return run_virtual(fly())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("first", [True, False])
def test_its_heartbeats_are_no_state_of_the_vehicle_and_it_is_named(
    fake_pair: Callable[..., Any], kind: tuple[int, int], *, first: bool
) -> None:
    async def script(driver: Driver, peer: Any, other: Other) -> None:
        sending = asyncio.create_task(other.run()) if first else None
        await asyncio.sleep(0.01)
        await driver.identify(5.0)
        await driver.ready(10.0)
        assert bool(driver.others) == first
        await driver.arm()
        sending = sending or asyncio.create_task(other.run())
        for _ in range(30):
            await asyncio.sleep(0.1)
            assert driver.state.armed
            assert driver.state.mode_name == "GUIDED"
        assert driver.identity.vehicle_type == "quadrotor"
        sending.cancel()

    events = flown(fake_pair, kind, script)
    (text,) = [event.text for event in events if event.kind == "other_sender"]
    assert text == (
        f"another sender of heartbeats has its ids (system 1, component 1): "
        f"{HeartbeatKind(*kind)}; they are ignored; give it a component id of its own"
    )
    assert [event.kind for event in events if event.kind in {"disarmed", "failsafe"}] == []


def test_its_heartbeats_are_no_sign_of_life(fake_pair: Callable[..., Any]) -> None:
    async def script(driver: Driver, peer: Any, other: Other) -> None:
        await driver.identify(5.0)
        peer.muted = True
        for _ in range(10):
            other.send()
            await asyncio.sleep(0.5)
        assert not driver.state.link_up

    events = flown(fake_pair, COMPANION, script)
    assert [event.kind for event in events if event.kind.startswith("link")] == ["link_lost"]


def test_kind_is_read_from_cut_frames_of_both_versions() -> None:
    beat = mavlink.MAVLink_heartbeat_message(*COMPANION, 0, 0, 0, 0)
    for version, protocol in ((2, False), (1, True)):
        raw = bytes(beat.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=protocol))
        (frame,) = FrameSplitter().feed(raw)
        assert (frame.version, heartbeat_kind(frame)) == (version, COMPANION)
    (other,) = FrameSplitter().feed(
        MavlinkCodec(system_id=1, component_id=1).pack(mavlink.MAVLink_ping_message(0, 0, 0, 0))
    )
    assert heartbeat_kind(other) is None
    assert str(HeartbeatKind(*COMPANION)) == "onboard_controller with autopilot invalid"
