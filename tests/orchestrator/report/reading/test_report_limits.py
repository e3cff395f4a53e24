"""What violated a limit and when the limit held, the things marked in an image, and contacts."""

import math
from dataclasses import replace
from typing import Any

import pytest

from tests.orchestrator.report.recorded_campaign import WORLD
from wil_campaign.foundation.files.documents import parse_document
from wil_campaign.orchestrator.reading.judged_motion import JudgedMotion
from wil_campaign.orchestrator.report.model import CameraView, PageImage, VerdictCause
from wil_campaign.orchestrator.report.reading.closeup import JudgedFlight, closeup_of
from wil_campaign.orchestrator.report.reading.distances import contact_until_s
from wil_campaign.orchestrator.report.reading.held_limits import held_limits
from wil_campaign.orchestrator.report.reading.object_marks import (
    SeenWorld,
    marks_of,
    objects_named_in_texts,
    touched_part,
)
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.vehicles.embedded.physics.contact_world import BODY
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.scene import Scene
from wil_campaign.worlds.world_file.world import World

STAGES = {"takeoff": 1.0, "at_height": 3.0, "goal": 5.0, "land": 15.0, "landed": 20.0}


def scene() -> Scene:
    document = parse_document(str(WORLD).replace("'", '"').encode(), name="world")
    return World.parse(document).scene("wil", "Wv")


def spans(oracles: dict[str, Any]) -> list[tuple[str, float, bool, tuple[float, float]]]:
    found = held_limits(oracles, STAGES, 21.0, "real")
    return [(one.signal, one.value, one.is_upper, one.span_s) for one in found]


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("always[0,3.5] (up_m <= 1.3)", [("up_m", 1.3, True, (5.0, 8.5))]),
        ("always (1.3 >= up_m)", [("up_m", 1.3, True, (5.0, 15.0))]),
        ("always[1,2] (always[0,1] (up_m > 0.5))", [("up_m", 0.5, False, (6.0, 8.0))]),
        ("eventually (up_m >= 2.0)", []),
        ("always[0,3] (up_m <= 1 or speed_m_s <= 1)", []),
        ("always[0,90] (up_m <= 1.3)", [("up_m", 1.3, True, (5.0, 15.0))]),
        ("up_m <= 1.3", []),
        ("always[0,3] (up_m <=", []),
    ],
)
def test_a_limit_of_a_formula_holds_in_its_interval(formula: str, expected: list[Any]) -> None:
    assert spans({"waits": {"stl": formula}}) == expected


def test_a_lower_limit_does_not_hold_while_the_vehicle_takes_off_and_lands() -> None:
    assert spans({"altitude": {"min_m": 0.5, "max_m": 2.3}}) == [
        ("up_m", 2.3, True, (1.0, 20.0)),
        ("up_m", 0.5, False, (3.0, 15.0)),
    ]
    assert spans({"near": {"use": "distance", "object": "gate", "min_m": 1.0}}) == [
        ("distance to gate", 1.0, False, (3.0, 15.0))
    ]
    assert spans({"odd": {"use": "no such kind"}, "none": 5}) == []


def climbing() -> JudgedFlight:
    """At 1 m up to 6 s, then to 2 m until 8 s, and back to 1.5 m at once."""
    motion = JudgedMotion()
    for k in range(200):
        t_s = k / 10
        up_m = 1.5 if t_s > 8.0 else 1.0 + max(0.0, t_s - 6.0) / 2.0
        motion.poses.setdefault("real", []).append((t_s, Pose.of(0.0, 0.0, up_m)))
        motion.velocities.setdefault("real", []).append((0.0, 0.0, 0.0))
    fence = Fence.box(north_m=(-1.0, 1.0), east_m=(-1.0, 1.0), up_m=(-1.0, 1.8))
    return JudgedFlight(motion, Scene(), {"real": [(-math.inf, fence)]})


def failed(actual: float, margin: float, detail: str, name: str = "waits") -> OracleResult:
    return OracleResult(name, "real", True, "FAIL", actual, 1.3, "m", margin, 6.6, detail)


def test_the_violated_value_is_shown_over_the_interval_of_its_limit() -> None:
    limits = held_limits({"waits": {"stl": "always[0,2.5] (up_m <= 1.3)"}}, STAGES, 21.0, "real")
    oracle = failed(1.75, -0.45, "up_m <= 1.3 is violated: 1.750 m against 1.3 m")
    found = closeup_of(VerdictCause("waits", "", (), 6.6), oracle, limits, climbing())
    assert found is not None
    (limit,) = found.plot.limits
    assert (limit.value, limit.is_upper, limit.span_s) == (1.3, True, (5.0, 7.5))
    # It goes higher when the limit holds no more: that is no violation.
    assert found.worst == pytest.approx((7.5, 1.75))
    assert found.span_s[0] == pytest.approx(4.0)
    assert found.span_s[1] == pytest.approx(9.0)


def test_a_closeup_that_differs_from_the_judged_value_is_not_shown() -> None:
    limits = held_limits({"waits": {"stl": "always[0,2.5] (up_m <= 1.3)"}}, STAGES, 21.0, "real")
    cause = VerdictCause("waits", "", (), 6.6)
    detail = "up_m <= 1.3 is violated"
    assert closeup_of(cause, failed(2.4, -1.1, detail), limits, climbing()) is None
    assert closeup_of(cause, failed(1.75, -0.45, "other <= 1"), limits, climbing()) is None
    assert closeup_of(None, failed(1.75, -0.45, detail), limits, climbing()) is None
    signals = held_limits({"waits": {"stl": "always (battery_v >= 3)"}}, STAGES, 21.0, "real")
    low = failed(1.75, -0.45, "battery_v >= 3 is violated")
    assert closeup_of(cause, low, signals, climbing()) is None


def test_the_margin_to_the_fence_is_a_lower_limit() -> None:
    limits = held_limits({"geofence": {}}, STAGES, 21.0, "real")
    oracle = failed(-0.2, -0.2, "", "geofence")
    found = closeup_of(VerdictCause("geofence", "", (), 7.7), oracle, limits, climbing())
    assert found is not None
    assert found.worst == pytest.approx((8.0, -0.2))
    assert found.plot.title == "margin to the fence"


def test_the_margin_is_to_the_fence_that_was_in_force_then() -> None:
    limits = held_limits({"geofence": {}}, STAGES, 21.0, "real")
    flight = climbing()
    # Wide again after it was left: the vehicle was outside of the one of that time.
    wide = Fence.box(north_m=(-1.0, 1.0), east_m=(-1.0, 1.0), up_m=(-1.0, 5.0))
    flight = replace(flight, fences={"real": [*flight.fences["real"], (9.0, wide)]})
    found = closeup_of(
        VerdictCause("geofence", "", (), 7.7), failed(-0.2, -0.2, "", "geofence"), limits, flight
    )
    assert found is not None
    assert found.worst == pytest.approx((8.0, -0.2))


def seen(vehicle: str = "real", source: str = "mixed") -> PageImage:
    view = CameraView(vehicle, Intrinsics(640, 480, 400.0, 400.0, 319.5, 239.5))
    return PageImage(source, 1.0, 1.05, 320, 240, "", view)


def world(north_m: float, recipe: str = "", **sensor: Any) -> SeenWorld:
    poses = [(t_s, Pose.of(north_m, 0.0, 1.2)) for t_s in (0.9, 1.1)]
    campaign: dict[str, Any] = {
        "vehicles": {"real": {"sensors": {"camera": {"type": "camera", **sensor}}}}
    }
    return SeenWorld(scene(), frozenset({"gate"}), {"real": poses}, {}, campaign, recipe)


def test_a_thing_is_boxed_where_the_recorded_world_and_pose_have_it() -> None:
    (mark,) = marks_of(seen(), "camera", world(0.0), of_interest=["gate", "nothing"])
    assert mark.name == "gate"
    assert mark.box_px is not None
    left, top, right, bottom = mark.box_px
    # 1.2 m wide with its bars, its near face 1.95 m ahead; the image is half as wide as recorded.
    half_px = 400.0 * 0.6 / 1.95 / 2.0
    assert (left, right) == pytest.approx((160.0 - half_px, 160.0 + half_px), abs=0.5)
    assert (top, bottom) == pytest.approx((120.0 - half_px, 120.0 + half_px), abs=0.5)
    assert mark.distance_m == pytest.approx(1.8, abs=0.2)
    assert mark.outline_px == ()


def test_the_touched_part_is_outlined_and_objects_behind_it_have_no_box() -> None:
    (mark,) = marks_of(
        seen(),
        "camera",
        world(1.0),
        of_interest=["gate"],
        touched=touched_part("touched gate.left"),
    )
    assert mark.part == "left"
    assert mark.outline_px
    assert all(x < 160.0 for x, _ in mark.outline_px)
    (mark,) = marks_of(seen(), "camera", world(3.0), of_interest=["gate"])
    assert mark.box_px is None
    assert mark.distance_m is not None


def test_a_turned_camera_sees_elsewhere_and_one_that_is_not_known_nowhere() -> None:
    (mark,) = marks_of(seen(), "camera", world(0.0, mount={"yaw_deg": 180}), of_interest=["gate"])
    assert mark.box_px is None
    assert marks_of(seen(), "camera", world(0.0, calibration="a.yaml"), of_interest=["gate"]) == ()
    assert marks_of(seen(), "camera", world(0.0, mount={"odd": 1}), of_interest=["gate"]) == ()
    late = PageImage("mixed", 9.0, 9.1, 320, 240, "", seen().view)
    assert marks_of(late, "camera", world(0.0), of_interest=["gate"]) == ()


def test_a_virtual_object_is_marked_only_where_the_recipe_registered_it() -> None:
    virtual = SeenWorld(
        scene(), frozenset(), world(0.0).poses, {}, world(0.0).campaign, '{"combine": []}'
    )
    assert marks_of(seen(), "camera", virtual, of_interest=["gate"]) == ()
    text = '{"combine": [{"sensor": "camera", "transform": [{"register": {"pose": "real"}}]}]}'
    registered = SeenWorld(scene(), frozenset(), world(0.0).poses, {}, world(0.0).campaign, text)
    assert marks_of(seen(), "camera", registered, of_interest=["gate"])[0].box_px is not None


def test_things_are_named_as_words_and_as_things_of_parts() -> None:
    assert objects_named_in_texts(scene(), ["closest to gate.left", ""]) == ["gate"]
    assert objects_named_in_texts(scene(), ["gateway, agate"]) == []
    assert touched_part("closest to gate.left") == ""


def test_a_contact_is_over_when_the_body_is_clear_again() -> None:
    # Through the left bar of the gate and out on the far side.
    through = [(k / 10, Pose.of(k / 10, -0.55, 1.2)) for k in range(40)]
    until_s = contact_until_s(through, BODY, scene(), {}, 1.8)
    assert until_s is not None
    assert 2.0 < until_s < 2.5
    assert contact_until_s(through[:20], BODY, scene(), {}, 1.8) is None
