"""Reads a simulator's ground truth: HIL_STATE_QUATERNION of PX4, SIM_STATE of ArduPilot; pure.

Both are sent by simulations only (SITL, hardware in the loop). Their content, by the firmwares'
sources:

PX4 (src/modules/mavlink/streams/HIL_STATE_QUATERNION.hpp) fills it from its *_groundtruth topics,
and sends none when no simulator publishes those. Degrees times 1e7, millimetres above sea level,
cm/s, all truncated to integers. In PX4 of August 2026 time_usec is the time of validity since
boot, the epoch of time_boot_ms; in earlier versions it was 0.

ArduPilot (SIM::sim_state_send, libraries/SITL/SITL.cpp): attitude and velocity as floats; lat and
lon are 32-bit floats, 0.4 m apart at 47 degrees (versions without lat_int put degrees times 1e7
there): only lat_int and lon_int are used. Heights are of whole centimetres. It has no time.
SIMSTATE has neither height nor velocity nor time: it is not used.
"""

import math
from typing import Any, NamedTuple

from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.worlds.frames import Quat, Vec3, quat_normalize

_UNIT_WITHIN = 0.1
"""The largest difference of a quaternion's length from 1."""


class GroundTruthError(VehicleError):
    """A simulator's message is no usable ground truth; the error says what is missing."""


class GroundTruth(NamedTuple):
    """The vehicle's true position, attitude and velocity in a simulator.

    altitude_m: above mean sea level. q_wxyz: body (FRD) to north, east, down. boot_s: the time of
    validity that the message states; None when it states none.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    q_wxyz: Quat
    velocity_ned_m_s: Vec3
    boot_s: float | None = None


def read_hil_state(message: Any) -> GroundTruth:
    """Return the ground truth in a HIL_STATE_QUATERNION. Raises GroundTruthError."""
    if not (message.lat or message.lon or message.alt):
        raise GroundTruthError("HIL_STATE_QUATERNION has no position: the simulator publishes none")
    return GroundTruth(
        latitude_deg=message.lat * 1e-7,
        longitude_deg=message.lon * 1e-7,
        altitude_m=message.alt * 1e-3,
        q_wxyz=_unit("HIL_STATE_QUATERNION", tuple(message.attitude_quaternion)),
        velocity_ned_m_s=(message.vx * 0.01, message.vy * 0.01, message.vz * 0.01),
        boot_s=message.time_usec * 1e-6 if message.time_usec else None,
    )


def read_sim_state(message: Any) -> GroundTruth:
    """Return the ground truth in a SIM_STATE. Raises GroundTruthError."""
    if not (message.lat_int or message.lon_int):
        raise GroundTruthError(
            "SIM_STATE has no lat_int and lon_int, and its floats have a resolution of 0.4 m: "
            "use a newer ArduPilot"
        )
    numbers = (message.alt, message.vn, message.ve, message.vd)
    if not all(map(math.isfinite, numbers)):
        raise GroundTruthError("SIM_STATE has a height or velocity that is not a number")
    return GroundTruth(
        latitude_deg=message.lat_int * 1e-7,
        longitude_deg=message.lon_int * 1e-7,
        altitude_m=message.alt,
        q_wxyz=_unit("SIM_STATE", (message.q1, message.q2, message.q3, message.q4)),
        velocity_ned_m_s=(message.vn, message.ve, message.vd),
    )


def _unit(name: str, q_wxyz: Quat) -> Quat:
    """Return a ground truth's quaternion at length 1. Raises GroundTruthError."""
    length = math.hypot(*q_wxyz)
    if not abs(length - 1.0) < _UNIT_WITHIN:
        raise GroundTruthError(f"the attitude in {name} is no rotation: its length is {length:.3g}")
    return quat_normalize(q_wxyz)
