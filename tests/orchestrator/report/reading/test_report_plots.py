"""The values that the plots of a run show, and the limits drawn with them."""

import math
from collections.abc import Mapping, Sequence

from orchestrator.analysis.reading.judged_motion import JudgedMotion
from orchestrator.report.model import Plot
from orchestrator.report.reading.closeup import JudgedFlight
from orchestrator.report.reading.distances import TimedPose
from orchestrator.report.reading.held_limits import HeldLimit, held_limits
from orchestrator.report.reading.signal_plots import motion_plots
from safety.fence.geofence import Fence
from worlds.frames import Pose
from worlds.scene.scene import Scene

STAGES = {"takeoff": 0.0, "at_height": 1.0, "goal": 1.0, "land": 9.0, "landed": 10.0}


def plot_of(
    title: str,
    poses: Mapping[str, Sequence[TimedPose]],
    *,
    flight: JudgedFlight | None = None,
    limits: Sequence[HeldLimit] = (),
) -> Plot:
    nothing = JudgedFlight(JudgedMotion(), Scene(), {})
    found = motion_plots(poses, flight or nothing, "real", limits)
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


def fence(up_m: float) -> Fence:
    return Fence.box(north_m=(-9.0, 9.0), east_m=(-9.0, 9.0), up_m=(-9.0, up_m))


def test_a_fence_that_was_changed_in_flight_counts_from_then_on() -> None:
    fences = {"real": [(-math.inf, fence(1.8)), (4.0, fence(5.0))], "twin": [(6.0, fence(2.5))]}
    flight = JudgedFlight(JudgedMotion(), Scene(), fences)
    poses = {"real": hovering(2.0), "twin": hovering(2.0)}
    plot = plot_of("margin to the fence", poses, flight=flight)
    real, twin = (dict(curve.points) for curve in plot.curves)
    assert {round(margin, 6) for t_s, margin in real.items() if t_s < 4.0} == {-0.2}
    assert {round(margin, 6) for t_s, margin in real.items() if t_s >= 4.0} == {3.0}
    # What its fence was before is not recorded.
    assert min(twin) >= 6.0
    assert "in force at each time" in plot.note
