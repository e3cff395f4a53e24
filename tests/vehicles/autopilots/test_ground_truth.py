"""Ground truth messages of the firmwares' simulators: units, frames, and what is refused."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.ardupilot.strategy import ArduCopter
from wil_campaign.vehicles.autopilots.autopilot import Autopilot, TelemetryRates
from wil_campaign.vehicles.autopilots.ground_truth import GroundTruthError
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.worlds.frames import euler_from_quat

HALF = math.sqrt(0.5)
TURNED_EAST = (HALF, 0.0, 0.0, HALF)


def hil_state(**changes: Any) -> Any:
    """Return a HIL_STATE_QUATERNION of PX4 above Zurich, its nose to the east."""
    fields = {
        "time_usec": 0,
        "attitude_quaternion": TURNED_EAST,
        "rollspeed": 0.0,
        "pitchspeed": 0.0,
        "yawspeed": 0.0,
        "lat": 473977420,
        "lon": 85455940,
        "alt": 489_500,
        "vx": 120,
        "vy": -30,
        "vz": 5,
        "ind_airspeed": 0,
        "true_airspeed": 0,
        "xacc": 0,
        "yacc": 0,
        "zacc": 0,
    }
    return mavlink.MAVLink_hil_state_quaternion_message(**(fields | changes))


def sim_state(**changes: Any) -> Any:
    """Return a SIM_STATE of ArduCopter above Zurich, its nose to the east."""
    fields = {
        "q1": HALF,
        "q2": 0.0,
        "q3": 0.0,
        "q4": HALF,
        "roll": 0.0,
        "pitch": 0.0,
        "yaw": math.pi / 2.0,
        "xacc": 0.0,
        "yacc": 0.0,
        "zacc": -9.81,
        "xgyro": 0.0,
        "ygyro": 0.0,
        "zgyro": 0.0,
        "lat": 47.397742,
        "lon": 8.545594,
        "alt": 489.5,
        "std_dev_horz": 0.0,
        "std_dev_vert": 0.0,
        "vn": 1.2,
        "ve": -0.3,
        "vd": 0.05,
        "lat_int": 473977420,
        "lon_int": 85455940,
    }
    return mavlink.MAVLink_sim_state_message(**(fields | changes))


def _over_the_wire(message: Any) -> Any:
    """Return a message as it arrives: trailing zeros cut, floats of 32 bits."""
    sender, receiver = (
        MavlinkCodec(system_id=1, component_id=1),
        MavlinkCodec(system_id=2, component_id=1),
    )
    (arrived,) = receiver.parse(sender.pack(message))
    return arrived


@pytest.mark.parametrize(
    ("autopilot", "message"), [(Px4(), hil_state()), (ArduCopter(), sim_state())]
)
def test_units_and_frames(autopilot: Autopilot, message: Any) -> None:
    truth = autopilot.ground_truth(_over_the_wire(message))
    assert (truth.latitude_deg, truth.longitude_deg) == pytest.approx(
        (47.397742, 8.545594), abs=1e-9
    )
    assert truth.altitude_m == pytest.approx(489.5, abs=1e-4)
    assert truth.velocity_ned_m_s == pytest.approx((1.2, -0.3, 0.05), abs=1e-6)
    assert euler_from_quat(truth.q_wxyz) == pytest.approx((0.0, 0.0, math.pi / 2.0), abs=1e-6)
    assert math.hypot(*truth.q_wxyz) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("autopilot", "message", "said"),
    [
        (Px4(), hil_state(lat=0, lon=0, alt=0), "has no position"),
        (Px4(), hil_state(attitude_quaternion=(0.0, 0.0, 0.0, 0.0)), "is no rotation"),
        (Px4(), hil_state(attitude_quaternion=(math.nan, 0.0, 0.0, 0.0)), "is no rotation"),
        (ArduCopter(), sim_state(lat_int=0, lon_int=0), "use a newer ArduPilot"),
        (ArduCopter(), sim_state(alt=math.nan), "not a number"),
        (ArduCopter(), sim_state(vd=math.inf), "not a number"),
        (ArduCopter(), sim_state(q1=0.0, q4=0.0), "is no rotation"),
    ],
)
def test_imprecise_and_empty_messages_are_refused(
    autopilot: Autopilot, message: Any, said: str
) -> None:
    with pytest.raises(GroundTruthError, match=said):
        autopilot.ground_truth(_over_the_wire(message))


@pytest.mark.parametrize(("autopilot", "message_id"), [(Px4(), 115), (ArduCopter(), 108)])
def test_it_is_requested_only_where_it_is_wanted(autopilot: Autopilot, message_id: int) -> None:
    usual = {line.message_id for line in autopilot.telemetry_plan(TelemetryRates())}
    plan = autopilot.telemetry_plan(TelemetryRates(truth_hz=50.0))
    wanted = {line.message_id: line for line in plan}
    assert message_id not in usual
    assert (wanted[message_id].rate_hz, wanted[message_id].required) == (50.0, False)
