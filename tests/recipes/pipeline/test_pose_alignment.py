"""The pose for the twin's picture, by each kind of alignment."""

import pytest

from wil_campaign.recipes.pipeline.pose_alignment import align_pose
from wil_campaign.recipes.working import Align, PoseRequest
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.worlds.frames import Pose


def history() -> PoseHistory:
    """Return a vehicle that goes north at 1 m/s, seen every 100 ms up to 1.0 s."""
    made = PoseHistory(5.0)
    for tenth in range(11):
        made.add(tenth / 10, Pose((tenth / 10, 0.0, 0.0)), (1.0, 0.0, 0.0))
    return made


@pytest.mark.parametrize(
    ("align", "exposure_s", "north_m", "t_s", "how"),
    [
        ("interpolate", 0.55, 0.55, 0.55, "interpolated"),
        ("interpolate", 1.01, 1.01, 1.01, "predicted"),
        ("interpolate", 1.08, 1.0, 1.0, "latest"),
        ("hold", 0.58, 0.5, 0.5, "hold"),
        ("hold", 0.6, 0.6, 0.6, "hold"),
        ("latest", 0.95, 1.0, 1.0, "latest"),
    ],
)
def test_pose_and_the_time_it_stands_for(
    align: Align, exposure_s: float, north_m: float, t_s: float, how: str
) -> None:
    request = PoseRequest("real", align, 0.11)
    found = align_pose(request, history(), exposure_s=exposure_s, now_s=1.02)
    assert found is not None
    assert found.pose.position_ned_m[0] == pytest.approx(north_m)
    assert found.t_s == pytest.approx(t_s)
    assert found.how == how


@pytest.mark.parametrize("align", ["interpolate", "hold", "latest"])
def test_no_pose_when_none_is_near(align: Align) -> None:
    request = PoseRequest("real", align, 0.05)
    assert align_pose(request, history(), exposure_s=1.2, now_s=1.2) is None
    assert align_pose(request, PoseHistory(1.0), exposure_s=1.2, now_s=1.2) is None


def test_no_pose_before_the_first_sample() -> None:
    for align in ("interpolate", "hold"):
        request = PoseRequest("real", align, 1.0)
        assert align_pose(request, history(), exposure_s=-0.01, now_s=1.2) is None
