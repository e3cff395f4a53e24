"""Which setpoints ArduCopter flies in GUIDED, and that the others stop it.

By handle_message_set_position_target_local_ned and _global_int of ArduCopter's
GCS_MAVLink_Copter.cpp.
"""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.embedded.autopilot.bare_autopilot import BareAutopilot
from wil_campaign.plugins.ardupilot.copter.guided_setpoints import (
    is_flown_global_setpoint,
    is_flown_local_setpoint,
)
from wil_campaign.plugins.ardupilot.strategy import ArduCopter
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget

NO_POSITION, NO_VELOCITY, NO_ACCELERATION, FORCE = 0o7, 0o70, 0o700, 1 << 9
NOTHING, ONLY_YAW = 0xFFF, 0xBFF
VELOCITY = NO_POSITION | NO_ACCELERATION
POSITION = NO_VELOCITY | NO_ACCELERATION
DEGREES = (473977420, 85455940)


def local(mask: int, *, frame: int = 1, place: float = 1.0, speed: float = 1.0) -> Any:
    vectors = (place,) * 3 + (speed,) * 3 + (0.0,) * 3
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, *vectors, 0.0, 0.0
    )


def on_earth(mask: int, *, frame: int = 6, place: tuple[int, int] = DEGREES) -> Any:
    return mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, mask, *place, 3.0, *(1.0,) * 3, *(0.0,) * 3, 0.0, 0.0
    )


@pytest.mark.parametrize(
    ("mask", "flown"),
    [
        (VELOCITY, VELOCITY),
        (POSITION, POSITION),
        (NO_ACCELERATION, NO_ACCELERATION),
        (0, 0),
        # One ignored axis, and the vector is ignored.
        (0b1 | NO_ACCELERATION, VELOCITY),
        (0b1000 | NO_ACCELERATION, POSITION),
        (1 << 6, NO_ACCELERATION),
        (FORCE | VELOCITY, FORCE | VELOCITY),
    ],
)
def test_whole_vectors_are_flown(mask: int, flown: int) -> None:
    message = local(mask)
    assert is_flown_local_setpoint(message)
    assert message.type_mask == flown


@pytest.mark.parametrize(
    "message",
    [
        local(NOTHING),
        local(ONLY_YAW),
        local(0b1 | NO_VELOCITY | NO_ACCELERATION),
        local(0b1000 | NO_POSITION | NO_ACCELERATION),
        local(NO_POSITION | NO_VELOCITY),
        local(NO_VELOCITY),
        local(FORCE),
        local(VELOCITY, speed=math.nan),
        local(VELOCITY, speed=1001.0),
        local(POSITION, place=math.nan),
        *(local(VELOCITY, frame=frame) for frame in (0, 5, 12, 20)),
    ],
)
def test_a_message_that_is_no_setpoint_stops_it(message: Any) -> None:
    assert not is_flown_local_setpoint(message)


@pytest.mark.parametrize("frame", [1, 7, 8, 9])
def test_four_local_frames_are_flown(frame: int) -> None:
    assert is_flown_local_setpoint(local(VELOCITY, frame=frame))


def test_frame_and_place_of_a_global_setpoint_count() -> None:
    assert all(
        is_flown_global_setpoint(on_earth(POSITION, frame=frame)) for frame in (0, 3, 5, 6, 10, 11)
    )
    assert is_flown_global_setpoint(on_earth(NO_ACCELERATION))
    assert is_flown_global_setpoint(on_earth(VELOCITY, frame=1, place=(2_000_000_000, 0)))
    assert not is_flown_global_setpoint(on_earth(POSITION, frame=1))
    assert not is_flown_global_setpoint(on_earth(POSITION, place=(2_000_000_000, 0)))
    assert not is_flown_global_setpoint(on_earth(NO_ACCELERATION, frame=11))
    assert not is_flown_global_setpoint(on_earth(NOTHING))


def test_the_setpoints_that_we_send_are_flown() -> None:
    driver, target = ArduCopter(), MavlinkTarget(1, 1)
    for yaw_rad in (None, 0.5):
        velocity = driver.velocity_setpoint(
            target, t_boot_ms=0, velocity_ned_m_s=(1.0, 0.0, 0.0), yaw_rad=yaw_rad
        )
        position = driver.position_setpoint(
            target, t_boot_ms=0, position_ned_m=(1.0, 0.0, -2.0), yaw_rad=yaw_rad
        )
        for message in (velocity, position):
            mask = message.type_mask
            assert is_flown_local_setpoint(message)
            assert message.type_mask == mask


@pytest.mark.parametrize(
    "wrong",
    [local(0b1000 | NO_POSITION | NO_ACCELERATION), local(VELOCITY, frame=12), on_earth(NOTHING)],
    ids=["mask", "frame", "global"],
)
def test_it_stops_in_flight(wrong: Any) -> None:
    """ModeGuided::init: zero velocity, in VelAccel."""
    bare = BareAutopilot("ardupilot")
    bare.hover()
    bare.run(5.0)
    flight = bare.autopilot.flight
    bare.send(local(VELOCITY))
    bare.run(0.5)
    assert flight.target is not None
    assert flight.target.velocity_ned_m_s == (1.0, 1.0, 1.0)
    bare.send(wrong)
    bare.run(0.5)
    assert flight.target.position_ned_m == (None, None, None)
    assert flight.target.velocity_ned_m_s == (0.0, 0.0, 0.0)


def test_another_mode_ends_a_pause() -> None:
    bare = BareAutopilot("ardupilot")
    bare.hover()
    autopilot: Any = bare.autopilot
    assert bare.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0.0) == 0
    assert autopilot.guided.paused is not None
    assert bare.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 5) == 0
    assert autopilot.guided.paused is None


def test_a_stop_ends_a_pause() -> None:
    bare = BareAutopilot("ardupilot")
    bare.hover()
    bare.run(5.0)
    autopilot: Any = bare.autopilot
    assert bare.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0.0) == 0
    assert autopilot.guided.paused is not None
    bare.send(local(NOTHING))
    assert autopilot.guided.paused is None
