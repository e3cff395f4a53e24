"""Who a vehicle is by its AUTOPILOT_VERSION, as real autopilots sent theirs."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.autopilots.autopilot import Target
from vehicles.autopilots.px4 import Px4
from vehicles.driver.session.identity import Identity, identity_of, same_vehicle
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
