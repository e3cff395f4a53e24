"""Gyroscopes in another unit than rad/s show by how far they turn."""

import math

import numpy as np
import pytest

from wil_campaign.plugins.navigation.imu import TurnCheck
from wil_campaign.vehicles.readings import ImuReading
from wil_campaign.worlds.frames import Pose, Vec3, quat_from_euler

HZ = 200


def found(factor: float, *, late_s: float = 0.0, swing_rad: float = 0.1) -> str | None:
    """Return what is found in 10 s of leaning to and fro. late_s: of the poses' stamps."""
    rng, check = np.random.default_rng(3), TurnCheck()
    text = None
    for k in range(10 * HZ):
        t_s = k / HZ
        lean_rad = swing_rad * math.sin(2.0 * (t_s - late_s))
        noise = rng.normal(0.0, 0.05, 3).tolist()
        rate = 2.0 * swing_rad * math.cos(2.0 * t_s)
        rates: Vec3 = (noise[0], factor * (rate + 0.01) + noise[1], noise[2])
        pose = Pose((0.0, 0.0, -1.0), quat_from_euler(0.0, lean_rad, 0.0))
        reading = ImuReading(t_s, t_s, k, "real", (0.0, 0.0, -9.8), rates)
        text = check.receive(reading, pose)
    return text


@pytest.mark.parametrize("late_s", [0.0, 0.25])
@pytest.mark.parametrize("swing_rad", [0.05, 0.6, 1.2])
def test_a_sound_gyroscope_is_left_alone(late_s: float, swing_rad: float) -> None:
    assert found(1.0, late_s=late_s, swing_rad=swing_rad) is None


@pytest.mark.parametrize("swing_rad", [0.05, 0.6])
def test_rates_in_degrees_are_found(swing_rad: float) -> None:
    text = found(math.degrees(1.0), swing_rad=swing_rad)
    assert text is not None
    assert text.endswith("their unit is wrong (rad/s is expected), or their scale")


def test_rates_that_stay_small_while_the_vehicle_turns_are_found() -> None:
    assert found(math.radians(1.0), swing_rad=0.6) is not None


def test_an_attitude_that_steps_and_a_gap_are_no_fault_of_a_gyroscope() -> None:
    check = TurnCheck()
    for k in range(10 * HZ):
        t_s = k / HZ + 5.0 * (k >= 5 * HZ)
        pose = Pose((0.0, 0.0, -1.0), quat_from_euler(0.0, 0.0, float(k >= 7 * HZ)))
        reading = ImuReading(t_s, t_s, k, "real", (0.0, 0.0, -9.8), (0.0, 0.0, 0.0))
        assert check.receive(reading, pose) is None
