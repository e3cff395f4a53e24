"""The pipeline with every sensor: types are followed, bad readings counted, times told."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.recipes.samples import (
    beam,
    camera,
    cloud,
    depth,
    fix,
    imu,
    plain,
    pose,
    scan,
    sound,
)
from wil_campaign.foundation.files.documents import BadInput, parse_document
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.pipeline.pipeline import Mixer, compile_recipe
from wil_campaign.vehicles.readings import Reading
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.geodesy import LocalFrame

SENSORS: dict[str, tuple[Callable[..., Any], str]] = {
    "camera": (camera, "overlay"),
    "depth": (lambda **more: depth(3.0, **more), "{aggregate: min}"),
    "lidar": (lambda **more: scan([1.0, 2.0, 3.0], **more), "{aggregate: min}"),
    "lidar_points": (lambda **more: cloud([[1, 2, 3]], **more), "concatenate"),
    "rangefinder": (lambda **more: beam(3.0, **more), "{aggregate: min}"),
    "gps": (lambda **more: fix(47.0, 8.0, **more), "{replace: twin}"),
    "pose": (pose, "{aggregate: mean}"),
    "imu": (imu, "{aggregate: mean}"),
    "microphone": (lambda **more: sound([1, 2, 3], **more), "add"),
}


def mixer(sensor: str, body: str, *, declared: str = "", **more: Any) -> Mixer:
    text = (
        f"schema: wil/recipe/1\nsensors: {{s: {{type: {sensor}{declared}}}}}\n"
        f"combine: [{{sensor: s, {body}}}]\n"
    )
    recipe = load_recipe(parse_document(text.encode(), name="r.yaml"))
    (one,) = compile_recipe(recipe, **{"object_ids": {}, **more})
    return one


def refusal(sensor: str, body: str, declared: str = "") -> str:
    with pytest.raises(BadInput) as caught:
        mixer(sensor, body, declared=declared)
    (problem,) = caught.value.problems
    return problem.headline


def at(reading: Any, t_s: float) -> Any:
    return replace(reading, t_s=t_s, arrived_s=t_s, seq=round(t_s * 1000))


@pytest.mark.parametrize("sensor", SENSORS)
def test_every_sensor_is_mixed(sensor: str) -> None:
    make, merge = SENSORS[sensor]
    one = mixer(sensor, f"merge: {merge}")
    # Of sound the part of the same time is used.
    skew_s = 0.0 if sensor == "microphone" else 0.01
    for k in range(3):
        t_s = 1.0 + k / 10
        mixed = one.mix(at(make(source="real"), t_s), at(make(), t_s + skew_s), now_s=t_s + 0.05)
        assert mixed.provenance.dropped is None
        assert mixed.provenance.skew_ms == pytest.approx(1000.0 * skew_s)
        assert mixed.reading is not None
        assert (mixed.reading.source, mixed.reading.t_s) == ("mixed", t_s)
        assert mixed.reading.arrived_s == t_s + 0.05
    assert one.counts().mixed == 3


@pytest.mark.parametrize("sensor", [one for one in SENSORS if one != "microphone"])
def test_every_sensor_is_delayed_and_held(sensor: str) -> None:
    make, merge = SENSORS[sensor]
    body = f"transform: [{{delay: 100}}, {{resample: hold}}], merge: {merge}, max_skew_ms: 200"
    one = mixer(sensor, body)
    for k in range(4):
        one.offer("twin", at(make(), 1.0 + k * 0.04))
    mixed = one.mix(at(make(source="real"), 1.2), at(make(), 1.16), now_s=1.25)
    assert mixed.provenance.dropped is None
    assert mixed.provenance.twin_t_s == pytest.approx(1.04)


def test_a_choice_by_time_stands_before_steps_that_change_readings() -> None:
    said = refusal("lidar", "transform: [{resample_beams: real}, {delay: 100}], merge: overlay")
    assert (
        "'delay' selects among the received readings: it must come before 'resample_beams'" in said
    )
    other_side = "transform: [{resample_beams: real}, {delay: {by_ms: 100, on: real}}]"
    mixer("lidar", f"{other_side}, merge: {{aggregate: min}}")


BAD: list[tuple[str, Any, str]] = [
    ("camera", camera(plain()[:, :, 0]), "shape"),
    ("camera", camera(plain().astype(np.float32)), "type"),
    ("camera", camera(intrinsics=Intrinsics.from_fov(9, 9, 1.0)), "shape"),
    ("camera", camera(intrinsics=Intrinsics(64, 48, math.nan, 1.0, 1.0, 1.0)), "intrinsics"),
    ("camera", camera(intrinsics=Intrinsics(64, 48, -5.0, 1.0, 1.0, 1.0)), "intrinsics"),
    ("camera", camera(depth_m=np.full((48, 64), np.nan, np.float32)), "not_finite"),
    ("camera", scan([1.0]), "type"),
    ("depth", depth(np.nan), "not_finite"),
    ("depth", depth(-1.0), "negative"),
    ("lidar", scan([1.0, np.nan, 3.0]), "not_finite"),
    ("lidar", scan([1.0, -2.0, 3.0]), "negative"),
    ("lidar", scan([1.0], step_rad=math.inf), "not_finite"),
    ("lidar", replace(scan([1.0]), ranges_m=np.zeros(0, np.float32)), "empty"),
    ("lidar_points", cloud([[1, 2, np.inf]]), "not_finite"),
    ("rangefinder", beam(math.nan), "not_finite"),
    ("gps", fix(91.0, 0.0), "out_of_range"),
    ("gps", fix(math.inf, 0.0), "not_finite"),
    ("pose", pose(Pose((0, math.nan, 0))), "not_finite"),
    ("pose", pose(Pose((0, 0, 0), (2.0, 0, 0, 0))), "out_of_range"),
    ("imu", imu(rates_frd_rad_s=(math.nan, 0.0, 0.0)), "not_finite"),
    ("microphone", sound([]), "empty"),
    ("microphone", sound([1], rate=0), "out_of_range"),
    ("microphone", sound([1], t_s=math.nan), "time"),
]


@pytest.mark.parametrize(("sensor", "bad", "kind"), BAD)
def test_a_bad_reading_is_counted_with_its_reason_on_either_side(
    sensor: str, bad: Any, kind: str
) -> None:
    make, merge = SENSORS[sensor]
    one = mixer(sensor, f"merge: {merge}")
    good = make(source="real")
    mixed = one.mix(good, bad, now_s=1.1)
    assert mixed.provenance.dropped == "bad_twin"
    assert mixed.provenance.detail
    assert mixed.reading is not None
    for name in ("image_bgr", "depth_m", "ranges_m", "points_frd_m", "samples", "pose"):
        if hasattr(good, name) and name != "depth_m":
            assert np.array_equal(getattr(mixed.reading, name), getattr(good, name))
    nothing = one.mix(replace(bad, source="real"), make(t_s=1.05), now_s=1.2)
    assert (nothing.reading, nothing.provenance.dropped) == (None, "bad_real")
    assert one.counts().faults == ((f"real {kind}", 1), (f"twin {kind}", 1))


@pytest.mark.parametrize("sensor", SENSORS)
def test_time_that_runs_backwards_is_refused_as_long_as_it_does(sensor: str) -> None:
    make, merge = SENSORS[sensor]
    one = mixer(sensor, f"merge: {merge}")
    dropped = []
    for real_s, twin_s in ((1.0, 1.0), (1.1, 0.9), (1.2, 0.95), (1.15, 1.2), (1.3, 1.3)):
        mixed = one.mix(at(make(source="real"), real_s), at(make(), twin_s), now_s=1.5)
        dropped.append(mixed.provenance.dropped)
    assert dropped == [None, "bad_twin", "bad_twin", "bad_real", None]
    assert one.counts().faults == (("real backwards", 1), ("twin backwards", 2))


def test_a_change_of_resolution_in_flight_is_counted_once_and_never_a_wrong_picture() -> None:
    one = mixer("camera", "transform: [{resize: real}], merge: overlay")
    large, small = plain((1, 2, 3)), plain((1, 2, 3), 32, 24)
    told = []
    for k, image in enumerate((large, large, small, small, large)):
        t_s = 1.0 + k / 10
        mixed = one.mix(at(camera(source="real"), t_s), at(camera(image), t_s), now_s=t_s)
        assert mixed.reading is not None
        assert mixed.reading.image_bgr.shape == (48, 64, 3)
        told.append(mixed.provenance.dropped)
    assert told == [None, None, "bad_twin", None, "bad_twin"]
    assert one.counts().faults == (("twin changed", 2),)


def test_an_overlay_that_comes_too_late_disappears_and_is_counted() -> None:
    one = mixer("camera", "merge: overlay, max_latency_ms: 200")
    for k, (delay_s, dropped) in enumerate(((0.2, None), (0.21, "late"), (0.1, None))):
        t_s = 1.0 + k
        twin = at(camera(plain((1, 1, 1))), t_s)
        mixed = one.mix(at(camera(source="real"), t_s), twin, now_s=t_s + delay_s)
        assert mixed.provenance.dropped == dropped
        assert mixed.reading is not None
        assert (mixed.reading.image_bgr == 1).all() == (dropped is None)
    assert one.counts().dropped == (("late", 1),)


@settings(max_examples=30)
@given(st.floats(-2000, 2000), st.floats(-2000, 2000), st.floats(0, 100))
def test_a_twin_in_local_coordinates_is_mixed_with_a_real_fix(
    north: float, east: float, up: float
) -> None:
    origin = "latitude_deg: 47.0, longitude_deg: 8.0, altitude_m: 400.0"
    one = mixer(
        "gps",
        f"transform: [{{geodetic: {{{origin}}}}}], merge: {{replace: twin}}",
        declared=", twin_type: pose",
    )
    mixed = one.mix(fix(47.0, 8.0, "real"), pose(Pose((north, east, -up))), now_s=1.0)
    found: Any = mixed.reading
    back = LocalFrame(47.0, 8.0, 400.0).to_ned(
        found.latitude_deg, found.longitude_deg, found.altitude_m
    )
    assert back == pytest.approx((north, east, -up), abs=1e-5)


def test_a_twin_in_other_axes_and_units_is_read_right() -> None:
    """The twin says roll, pitch, yaw in degrees and feet, in ENU and FLU."""
    one = mixer(
        "pose",
        "transform: [{attitude: {order: euler_deg}}, {units: {length: ft}},"
        " {axes: {world: enu, body: flu}}], merge: {replace: twin}",
    )
    # Its nose points east (yaw 0 in ENU), 10 ft north and 20 ft up of the origin.
    written = Pose((0.0, 10.0, 20.0), (0.0, 0.0, 0.0, 0.0))
    found: Any = one.mix(pose(source="real"), pose(written), now_s=1.0).reading
    assert found.pose.position_ned_m == pytest.approx((3.048, 0.0, -6.096))
    assert found.pose.yaw_rad == pytest.approx(math.pi / 2)


def test_scans_of_different_beams_and_points_of_depth() -> None:
    one = mixer("lidar", "transform: [{resample_beams: real}], merge: {aggregate: min}")
    mixed: Any = one.mix(scan(np.full(36, 5.0), "real"), scan(np.full(360, 2.0)), now_s=1.0)
    assert mixed.reading.ranges_m.tolist() == [2.0] * 36
    seen = mixer(
        "lidar_points",
        "transform: [{to_points: {every: 8}}], merge: concatenate",
        declared=", twin_type: depth",
    )
    made: Any = seen.mix(cloud([[9, 9, 9]], "real"), depth(3.0), now_s=1.0).reading
    assert len(made.points_frd_m) == 1 + 6 * 8


def test_types_are_followed_through_the_steps() -> None:
    assert "works on pose, not on gps" in refusal(
        "gps",
        "transform: [{geodetic: {latitude_deg: 1, longitude_deg: 2}}], merge: {replace: twin}",
    )
    assert "twin reaches its merge as pose" in refusal(
        "gps", "merge: {replace: twin}", ", twin_type: pose"
    )
    assert "works on camera and depth, not on lidar" in refusal(
        "lidar", "transform: [{resize: real}], merge: {aggregate: min}"
    )
    assert "works on microphone, not on camera" in refusal("camera", "merge: add")
    assert "a soft edge applies to camera images" in refusal(
        "lidar", "merge: {overlay: {soft_edge_px: 2}}"
    )
    assert "have no min" in refusal("pose", "merge: {aggregate: min}")
    assert "cannot be interpolated" in refusal(
        "camera", "transform: [{resample: interpolate}], merge: overlay"
    )
    assert "a rangefinder has no speed" in refusal(
        "rangefinder", "transform: [{units: {speed: kn}}], merge: overlay"
    )
    assert "a sector applies to lidars" in refusal(
        "gps", "merge: {replace: {sector: {from_deg: 1, to_deg: 2}}}"
    )
    assert "has no 'satellites' (it has range_m" in refusal(
        "lidar", "merge: {replace: {when: {of: real, what: satellites, above: 3}}}"
    )
    assert "which has no pixels" in refusal("imu", "merge: overlay, max_registration_error_px: 2")


def test_each_source_is_asked_for_the_depth_that_the_recipe_needs() -> None:
    by_depth = mixer("camera", "merge: {overlay: {occlusion: by_depth}}")
    assert by_depth.needs == by_depth.real_needs == {"depth"}
    near = mixer("camera", "filter: [{isolate_depth: {max_m: 4, on: real}}], merge: overlay")
    assert not near.needs
    assert near.real_needs == {"depth"}


def test_raw_readings_may_go_out_beside_the_mixed_ones() -> None:
    assert mixer("camera", "merge: overlay, publish_raw: true").combination.publish_raw
    assert not mixer("camera", "merge: overlay").combination.publish_raw


def test_there_is_room_for_several_twins_and_one_flies() -> None:
    head = "schema: wil/recipe/1\ntwins: {}\nsensors: {{s: {{type: imu}}}}\n"
    body = "combine: [{sensor: s, merge: overlay}]\n"
    assert load_recipe(parse_document((head.format("[twin]") + body).encode(), name="r.yaml"))
    for given_twins, said in (
        ("[twin, other]", "several twins are not supported yet"),
        ("[other]", "the twin must be named 'twin'"),
        ("[]", "at least 1"),
    ):
        with pytest.raises(BadInput) as caught:
            load_recipe(parse_document((head.format(given_twins) + body).encode(), name="r.yaml"))
        (problem,) = caught.value.problems
        assert said in problem.headline
        assert problem.line == 2


def test_an_empty_cloud_is_a_fault_of_the_real_lidar_and_none_of_the_twins() -> None:
    one = mixer("lidar_points", "merge: concatenate")
    full, empty = cloud([[1, 2, 3]], "real"), cloud(np.zeros((0, 3)))
    mixed = one.mix(full, empty, now_s=1.1)
    assert mixed.provenance.dropped is None
    assert mixed.reading is not None
    assert np.array_equal(mixed.reading.points_frd_m, full.points_frd_m)
    dead = one.mix(at(replace(empty, source="real"), 2.0), at(empty, 2.0), now_s=2.1)
    assert dead.reading is None
    assert dead.provenance.dropped == "bad_real"
    assert one.counts().faults == (("real empty", 1),)


@pytest.mark.parametrize(
    "body",
    [
        "transform: [axes], merge: concatenate",
        "transform: [{remount: real}], merge: concatenate",
        "transform: [{units: {length: ft}}], merge: concatenate",
        "transform: [{delay: 0}, {resample: hold}], merge: concatenate",
        "filter: [{decimate: 2}], merge: concatenate",
        "filter: [{isolate_box: {forward_m: [0, 1]}}], merge: concatenate",
        "filter: [{isolate_sector: {from_deg: 0, to_deg: 90}}], merge: concatenate",
        "filter: [remove_outliers], merge: concatenate",
        "filter: [{isolate_objects: [gate]}], merge: concatenate",
        "filter: [{value_range: {min_m: 1}}], merge: concatenate",
        "merge: {replace: {source: twin, sector: {from_deg: 90, to_deg: 120}}}",
    ],
)
def test_no_step_stumbles_over_an_empty_cloud(body: str) -> None:
    one = mixer("lidar_points", body, object_ids={"gate": 3})
    nothing = cloud(np.zeros((0, 3)), object_ids=np.zeros(0, np.uint8))
    mixed = one.mix(cloud([[1, 0, 0]], "real"), nothing, now_s=1.1)
    assert mixed.provenance.dropped is None
    assert mixed.reading is not None
    assert len(mixed.reading.points_frd_m) == 1


def test_each_vehicle_may_get_a_mixture_of_its_own() -> None:
    text = (
        "schema: wil/recipe/1\nsensors: {s: {type: rangefinder}}\n"
        "combine:\n"
        "  - {sensor: s, merge: {aggregate: min}, publish: [real]}\n"
        "  - {sensor: s, merge: {replace: twin}, publish: [twin]}\n"
    )
    recipe = load_recipe(parse_document(text.encode(), name="r.yaml"))
    for_real, for_twin = compile_recipe(recipe, object_ids={})
    pair: tuple[Reading, Reading] = (beam(2.0, "real"), beam(5.0))
    found: list[Any] = [one.mix(*pair, now_s=1.0).reading for one in (for_real, for_twin)]
    assert [one.range_m for one in found] == [2.0, 5.0]
    assert [one.publish for one in (for_real, for_twin)] == [("real",), ("twin",)]
