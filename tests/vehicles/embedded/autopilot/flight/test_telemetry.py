"""What is sent of one motion agrees: each message has it in its own way."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.embedded.autopilot.bare_autopilot import READY_S, BareAutopilot
from wil_campaign.worlds.frames import Vec3, quat_from_euler, rotate

COURSES_DEG = (0.0, 37.0, 90.0, 180.0, 271.5, 359.9)


def sent(bare: BareAutopilot, name: str) -> Any:
    """Return the message of a name that the autopilot sends on request."""
    number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
    command = mavlink.MAV_CMD_REQUEST_MESSAGE
    ask = mavlink.MAVLink_command_long_message(1, 1, command, 0, number, 0, 0, 0, 0, 0, 0)
    answers = [*bare.send(ask), *bare.run(0.1)]
    return next(one for one in answers if one.get_type() == name)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("course_deg", COURSES_DEG)
def test_a_motion_is_one_in_all_messages(autopilot: str, course_deg: float) -> None:
    """It flies sideways: its course over ground is not its heading."""
    bare = BareAutopilot(autopilot)
    bare.run(READY_S[autopilot])
    course_rad, yaw_rad = math.radians(course_deg), math.radians(140.0)
    velocity: Vec3 = (3.0 * math.cos(course_rad), 3.0 * math.sin(course_rad), -0.4)
    bare.estimate[0:3] = (4.0, -3.0, -5.0)
    bare.estimate[3:6] = velocity
    bare.estimate[6:9] = euler = (0.05, -0.1, yaw_rad)
    bare.run(0.02)
    local = sent(bare, "LOCAL_POSITION_NED")
    assert (local.vx, local.vy, local.vz) == pytest.approx(velocity, abs=1e-6)
    place = sent(bare, "GLOBAL_POSITION_INT")
    assert (place.vx, place.vy, place.vz) == pytest.approx([100 * v for v in velocity], abs=0.5)
    assert place.hdg == 14000
    fix = sent(bare, "GPS_RAW_INT")
    assert fix.vel == 300
    assert (fix.cog / 100.0 - course_deg + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.006)
    assert fix.cog < 36000
    assert (fix.lat, fix.lon) == (place.lat, place.lon)
    assert fix.alt == place.alt
    shown = sent(bare, "VFR_HUD")
    assert (shown.groundspeed, shown.climb, shown.heading) == pytest.approx((3.0, 0.4, 140))
    angles = sent(bare, "ATTITUDE")
    assert (angles.roll, angles.pitch, angles.yaw) == pytest.approx(euler, abs=1e-6)
    if autopilot == "px4":
        odometry = sent(bare, "ODOMETRY")
        along = rotate(quat_from_euler(*euler), (odometry.vx, odometry.vy, odometry.vz))
        assert along == pytest.approx(velocity, abs=1e-5)
