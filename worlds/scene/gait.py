"""The gait of a walking person: limb poses as a function of the distance walked; pure.

Hips swing like pendulums, half a step to either side, arms against them; the knee bends while its
leg swings forward, feet stay level, and the trunk is as low as the straight leg lets it. On each
leg of its path a person starts from, and comes back to, standing with both feet together. As the
pose depends on the distance only, no point moves faster than a bound times the person's own speed.

Step length: speed = length x rate, and length / rate (the walk ratio) is about 0.0065 m per
step/min for adults at any speed (Sekiya and Nagasaki, Gait & Posture 7, 1998, 225-227).
"""

import math
from typing import Literal, get_args

from wil_campaign.worlds.frames import AT_ORIGIN, Pose, quat_from_euler, rotate
from wil_campaign.worlds.scene.motion import LegStride, MotionTravel

Joint = Literal[
    "trunk",
    "right arm",
    "left arm",
    "right thigh",
    "left thigh",
    "right shank",
    "left shank",
    "right foot",
    "left foot",
]
JOINTS: tuple[Joint, ...] = get_args(Joint)

HIP_M, KNEE_M, ANKLE_M, SHOULDER_M = 0.88, 0.48, 0.07, 1.38
"""Heights of the joints of a standing person of 1.75 m."""
_WALK_RATIO_M_MIN = 0.0065
_LONGEST_STEP_M = 1.2
_KNEE_TO_HIP = 2.6
"""Bend of the knee against swing of the hip: 60 degrees at 23, usual in walking."""
_ARM_TO_HIP = 0.8
_HIP_RAD_PER_M = (math.pi + 3.0) * math.asin(_LONGEST_STEP_M / 2.0 / HIP_M) / _LONGEST_STEP_M
"""How fast the hip turns at most, for each metre walked: swing and its beginning together."""
CHORD_S = 0.02
"""For so long a limb moves straight: within 1 cm at 1.4 m/s, within 3 cm at 2.5 m/s."""
_KNEE_RAD_PER_M = _KNEE_TO_HIP * _HIP_RAD_PER_M


def _bounds() -> dict[Joint, tuple[float, float]]:
    """Return how far, and by what angle, a limb goes beyond its person for each metre walked."""
    hip_rad, knee_rad = _HIP_RAD_PER_M, _KNEE_RAD_PER_M
    low_m, hip_m, knee_m = hip_rad * HIP_M, hip_rad * HIP_M, knee_rad * KNEE_M
    limbs: dict[str, tuple[float, float]] = {
        "trunk": (low_m, 0.0),
        "arm": (low_m + hip_rad * SHOULDER_M, hip_rad),
        "thigh": (low_m + hip_m, hip_rad),
        "shank": (low_m + hip_m + knee_m + hip_rad * 2.0 * KNEE_M, hip_rad + knee_rad),
        "foot": (low_m + hip_m + knee_m, 0.0),
    }
    return {joint: limbs[joint.rpartition(" ")[2]] for joint in JOINTS}


_BOUNDS = _bounds()


def step_m(speed_m_s: float) -> float:
    """Return the length of a step at a speed."""
    return min(math.sqrt(_WALK_RATIO_M_MIN * 60.0 * speed_m_s), _LONGEST_STEP_M)


def limb_pose(joint: Joint, stride: LegStride | None) -> Pose:
    """Return the pose of a limb relative to that of a standing person; stride None: standing."""
    if stride is None or stride.length_m <= 0.0:
        return AT_ORIGIN
    length_m = step_m(stride.speed_m_s)
    left_m = stride.length_m - stride.along_m
    begun = max(0.0, min(1.0, 2.0 * stride.along_m / length_m, 2.0 * left_m / length_m))
    weight = begun * begun * (3.0 - 2.0 * begun)
    reach_rad = weight * math.asin(length_m / 2.0 / HIP_M)
    phase_rad = math.pi * stride.along_m / length_m + (0.0 if "right" in joint else math.pi)
    hip_rad = reach_rad * math.sin(phase_rad)
    low = Pose((0.0, 0.0, (HIP_M - ANKLE_M) * (1.0 - math.cos(hip_rad))))
    if joint == "trunk":
        return low
    if joint in {"right arm", "left arm"}:
        return low.compose(_turn(SHOULDER_M, -_ARM_TO_HIP * hip_rad))
    thigh = low.compose(_turn(HIP_M, hip_rad))
    if joint in {"right thigh", "left thigh"}:
        return thigh
    bend_rad = _KNEE_TO_HIP * reach_rad * max(0.0, math.cos(phase_rad)) ** 2
    shank = thigh.compose(_turn(KNEE_M, -bend_rad))
    if joint in {"right shank", "left shank"}:
        return shank
    forward, right, down = shank.to_parent((0.0, 0.0, -ANKLE_M))
    # A knee that bends before the hip swings back stretches the leg by some millimetres.
    return Pose((forward, right, min(0.0, down + ANKLE_M)))


def limb_travel(joint: Joint, walked: MotionTravel) -> MotionTravel:
    """Return a bound of how far a limb goes and turns while its person walks."""
    length_m, turn_rad = _BOUNDS[joint]
    return MotionTravel(
        walked.length_m * (1.0 + length_m), walked.turn_rad + walked.length_m * turn_rad
    )


def _turn(height_m: float, pitch_rad: float) -> Pose:
    """Return the pose of a turn about an axis to the right at a height; forward is positive."""
    q_wxyz = quat_from_euler(0.0, pitch_rad, 0.0)
    forward, right, down = rotate(q_wxyz, (0.0, 0.0, height_m))
    return Pose((forward, right, down - height_m), q_wxyz)
