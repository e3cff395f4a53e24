"""Reads a simulator's ground truth, HIL_STATE_QUATERNION of PX4; pure.

Only simulations send it (SITL, hardware in the loop). Its content, by the firmware's source:

PX4 (src/modules/mavlink/streams/HIL_STATE_QUATERNION.hpp) fills it from its *_groundtruth topics,
and sends none when no simulator publishes those. Degrees times 1e7, millimetres above sea level,
cm/s, all truncated to integers. In PX4 of August 2026 time_usec is the time of validity since
boot, the epoch of time_boot_ms; in earlier versions it was 0.
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
        q_wxyz=unit_attitude("HIL_STATE_QUATERNION", tuple(message.attitude_quaternion)),
        velocity_ned_m_s=(message.vx * 0.01, message.vy * 0.01, message.vz * 0.01),
        boot_s=message.time_usec * 1e-6 if message.time_usec else None,
    )


def unit_attitude(name: str, q_wxyz: Quat) -> Quat:
    """Return a ground truth's quaternion at length 1. Raises GroundTruthError."""
    length = math.hypot(*q_wxyz)
    if not abs(length - 1.0) < _UNIT_WITHIN:
        raise GroundTruthError(f"the attitude in {name} is no rotation: its length is {length:.3g}")
    return quat_normalize(q_wxyz)
