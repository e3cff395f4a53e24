"""Who a vehicle is by its AUTOPILOT_VERSION, as real autopilots sent theirs."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.session.identity import (
    VehicleIdentity,
    WantedVehicle,
    describe_mismatches,
    identity_of,
    matching_vehicle,
    same_vehicle,
)
from wil_campaign.vehicles.driver.session.session import HeartbeatSender, ReceivedHeartbeat
from wil_campaign.vehicles.embedded.autopilot.flight.autopilot_state import (
    EmulatedIdentity as Embedded,
)
from wil_campaign.vehicles.embedded.autopilot.px4 import px4_telemetry
from wil_campaign.vehicles.mavlink.heartbeats import HeartbeatKind

CONSTANT = 0x4954414C44494E4F


def version(uid: int, uid2: bytes) -> Any:
    return mavlink.MAVLink_autopilot_version_message(
        0, 0x01110040, 0, 0, 1, [0] * 8, [0] * 8, [0] * 8, 0, 0, uid, tuple(uid2.ljust(18, b"\0"))
    )


def known(system: int, version: Any) -> VehicleIdentity:
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 29, 0, 3, 3)
    received = ReceivedHeartbeat(heartbeat, 0.0, 2)
    return identity_of(Px4(), MavlinkTarget(system), received, version, is_simulated=False)


@pytest.mark.parametrize("system", [1, 2, 3, 250])
def test_px4_in_sitl_is_a_simulation_whatever_its_system_id(system: int) -> None:
    """As a real one of system 3 told: it was taken for a board, and its flights for hardware's."""
    real = version(CONSTANT + system - 1, bytes([system - 1]))
    embedded = px4_telemetry.autopilot_version(Embedded(system_id=system))
    assert (embedded.uid, bytes(embedded.uid2)) == (real.uid, bytes(real.uid2))
    assert known(system, real).simulation
    assert known(system, version(CONSTANT, b"")).simulation


def test_a_board_is_no_simulation() -> None:
    one, other = (known(system, version(0x3132, b"\x01" * 18)) for system in (1, 2))
    assert not one.simulation
    assert same_vehicle(one, other)


def test_an_autopilot_with_another_component_id_is_refused() -> None:
    """Guard and redundant links read the frames of component 1 only."""
    heartbeat = ReceivedHeartbeat(mavlink.MAVLink_heartbeat_message(2, 12, 29, 0, 3, 3), 0.0, 2)
    kind = HeartbeatKind(2, 12)
    other, one = {HeartbeatSender(1, 2, kind): heartbeat}, {HeartbeatSender(1, 1, kind): heartbeat}
    assert matching_vehicle(other, WantedVehicle()) is None
    assert describe_mismatches(other, WantedVehicle()) == (
        "system 1 component 2 is px4, and only autopilots with component id 1 are supported; set "
        "its component id to 1 (PX4: MAV_COMP_ID)"
    )
    found = matching_vehicle({**other, **one}, WantedVehicle())
    assert found is not None
    assert found[0].target == MavlinkTarget(1, 1)


REQUEST = f"COMMAND_LONG:{mavlink.MAV_CMD_REQUEST_MESSAGE}"


def answer(board: int, *, shows_truth: bool) -> Callable[[Any, Any], None]:
    """Return what an ArduPilot answers to requests of a message."""

    def reply(peer: Any, message: Any) -> None:
        peer.ack(message)
        if message.param1 == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            peer.say(
                mavlink.MAVLink_autopilot_version_message(
                    0, 0x04060000, 0, 0, board, *[[0] * 8] * 3, 0, 0, 77
                )
            )
        elif message.param1 == mavlink.MAVLINK_MSG_ID_SIM_STATE and shows_truth:
            peer.say(mavlink.MAVLink_sim_state_message(*[0.0] * 21))

    return reply


@pytest.mark.parametrize(
    ("board", "shows_truth", "simulation", "within_s"),
    [
        (0, True, True, 1.1),  # SITL; its second heartbeat comes after 1 s
        (0, False, False, 3.6),  # a Navio2: ArduPilot for Linux names no board
        (1 << 16, False, False, 1.1),
        (1 << 16, True, False, 1.1),  # a simulation on a board's hardware
    ],
)
def test_an_ardupilot_is_a_simulation_only_where_it_shows_it(
    fake_pair: Callable[..., Any],
    board: int,
    shows_truth: bool,
    simulation: bool,
    within_s: float,
) -> None:
    async def identify() -> tuple[bool, float]:
        link, peer = fake_pair("ardupilot")
        peer.replies[REQUEST] = answer(board, shows_truth=shows_truth)
        loop = asyncio.get_running_loop()
        async with peer, Driver(name="real", link=link) as driver:
            identity = await driver.identify(5.0)
            return identity.simulation, loop.time()

    found, took_s = run_virtual(identify())
    assert found is simulation
    assert took_s < within_s
