"""The values that the plots of a run show, and the limits drawn with them."""

from collections.abc import Mapping, Sequence

from orchestrator.analysis.reading.judged_motion import JudgedMotion
from orchestrator.report.model import Plot
from orchestrator.report.reading.distances import TimedPose
from orchestrator.report.reading.held_limits import HeldLimit, held_limits
from orchestrator.report.reading.signal_plots import motion_plots
from orchestrator.report.reading.world_facts import RecordedWorld
from worlds.frames import Pose

STAGES = {"takeoff": 0.0, "at_height": 1.0, "goal": 1.0, "land": 9.0, "landed": 10.0}


def plot_of(
    title: str,
    poses: Mapping[str, Sequence[TimedPose]],
    *,
    world: RecordedWorld | None = None,
    motion: JudgedMotion | None = None,
    limits: Sequence[HeldLimit] = (),
) -> Plot:
    found = motion_plots(poses, world or RecordedWorld(), motion or JudgedMotion(), "real", limits)
    return next(one for one in found if one.title == title)


def hovering(up_m: float, seconds: float = 10.0) -> list[TimedPose]:
    return [(k / 50, Pose.of(0.0, 0.0, up_m)) for k in range(round(seconds * 50) + 1)]


def test_the_limits_of_the_twins_oracles_are_not_drawn_for_the_real_vehicle() -> None:
    oracles = {
        "altitude": {"max_m": 3.0},
        "low": {"use": "altitude", "max_m": 1.0, "vehicle": "twin"},
        "lower": {"stl": "always (up_m <= 0.5)", "vehicle": "twin"},
    }
    limits = held_limits(oracles, STAGES, 10.0, "real")
    poses = {"real": hovering(2.0), "twin": hovering(0.4)}
    height = plot_of("height", poses, limits=limits)
    assert height.judged == "real"
    assert [one.value for one in height.limits] == [3.0]
    assert [(one.oracle, one.vehicle) for one in limits] == [
        ("altitude", "real"),
        ("low", "twin"),
        ("lower", "twin"),
    ]
