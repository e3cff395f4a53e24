"""The signals of a pose, each by a value of its own."""

import math

import pytest

from wil_campaign.safety.model import signals
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.worlds.frames import Pose, quat_from_euler

POSE = PoseSample(
    1.0,
    "real",
    Pose((1.0, 2.0, -3.0), quat_from_euler(*map(math.radians, (10.0, -20.0, 30.0)))),
    (3.0, 4.0, -12.0),
)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("north_m", 1.0),
        ("east_m", 2.0),
        ("up_m", 3.0),
        ("speed_m_s", 13.0),
        ("ground_speed_m_s", 5.0),
        ("climb_m_s", 12.0),
        ("vertical_speed_m_s", 12.0),
        ("roll_deg", 10.0),
        ("pitch_deg", -20.0),
        ("yaw_deg", 30.0),
        ("tilt_deg", math.degrees(math.acos(math.cos(0.17453293) * math.cos(0.34906585)))),
    ],
)
def test_each_signal_is_of_its_own_axis(name: str, value: float) -> None:
    assert getattr(signals, name)(POSE) == pytest.approx(value, abs=1e-6)
