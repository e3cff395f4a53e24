"""Who a vehicle is by its AUTOPILOT_VERSION, as real autopilots sent theirs."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.autopilots.autopilot import Target
from vehicles.autopilots.px4 import Px4
from vehicles.driver.session.identity import (
    Identity,
    Wanted,
    describe_mismatches,
    identity_of,
    matching_vehicle,
    same_vehicle,
)
from vehicles.driver.session.session import ReceivedHeartbeat
from vehicles.embedded.autopilot.flight.autopilot_state import Identity as Embedded
from vehicles.embedded.autopilot.px4 import px4_telemetry

CONSTANT = 0x4954414C44494E4F


def version(uid: int, uid2: bytes) -> Any:
    return mavlink.MAVLink_autopilot_version_message(
        0, 0x01110040, 0, 0, 1, [0] * 8, [0] * 8, [0] * 8, 0, 0, uid, tuple(uid2.ljust(18, b"\0"))
    )


def known(system: int, version: Any) -> Identity:
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 29, 0, 3, 3)
    return identity_of(Px4(), Target(system), ReceivedHeartbeat(heartbeat, 0.0, 2), version)


@pytest.mark.parametrize("system", [1, 2, 3, 250])
def test_px4_in_sitl_is_a_simulation_whatever_its_system_id(system: int) -> None:
    """As a real one of system 3 told: it was taken for a board, and its flights for hardware's."""
    real = version(CONSTANT + system - 1, bytes([system - 1]))
    embedded = px4_telemetry.autopilot_version(Embedded(system_id=system))
    assert (embedded.uid, bytes(embedded.uid2)) == (real.uid, bytes(real.uid2))
    assert known(system, real).simulation
    assert known(system, version(CONSTANT, b"")).simulation


def test_a_board_is_none() -> None:
    one, other = (known(system, version(0x3132, b"\x01" * 18)) for system in (1, 2))
    assert not one.simulation
    assert same_vehicle(one, other)


def test_an_autopilot_with_another_component_id_is_refused() -> None:
    """Guard and redundant links read the frames of component 1 only."""
    heartbeat = ReceivedHeartbeat(mavlink.MAVLink_heartbeat_message(2, 12, 29, 0, 3, 3), 0.0, 2)
    other, one = {Target(1, 2): heartbeat}, {Target(1, 1): heartbeat}
    assert matching_vehicle(other, Wanted()) is None
    assert describe_mismatches(other, Wanted()) == (
        "system 1 component 2 is px4, and only autopilots with component id 1 are supported; set "
        "its component id to 1 (PX4: MAV_COMP_ID)"
    )
    found = matching_vehicle({**other, **one}, Wanted())
    assert found is not None
    assert found[0] == Target(1, 1)
