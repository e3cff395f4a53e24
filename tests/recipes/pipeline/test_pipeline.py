"""The pipeline mixes, tells where each mixture comes from, and never shows a stale overlay."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wil_campaign.foundation.files.documents import parse_document
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.pipeline.mixture import MixCounts, MixedReading
from wil_campaign.recipes.pipeline.pipeline import Mixer, compile_recipe
from wil_campaign.recipes.working import PoseRequest, StepError
from wil_campaign.vehicles.readings import BgrImage, CameraReading, Source
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

WIDTH, HEIGHT = 64, 48
CAMERA = Intrinsics.from_fov(WIDTH, HEIGHT, 1.2)
BLUE_BGR, ORANGE_BGR = (230, 40, 20), (0, 120, 255)

GATE = (
    "transform: [{resize: {to: real}}, {register: {pose: real, align: interpolate}}],"
    " filter: [{isolate_color: {name: orange}}],"
    " merge: {overlay: {priority: [twin, real]}}, max_skew_ms: 60"
)


def mixer(body: str = GATE, **more: Any) -> Mixer:
    text = (
        "schema: wil/recipe/1\nsensors: {camera: {type: camera}}\n"
        f"combine: [{{sensor: camera, {body}}}]\n"
    )
    recipe = load_recipe(parse_document(text.encode(), name="r.yaml"))
    (one,) = compile_recipe(recipe, object_ids={"gate": 7}, **more)
    return one


def gate_picture() -> BgrImage:
    image = np.full((HEIGHT, WIDTH, 3), (90, 90, 90), np.uint8)
    image[10:30, 20:25] = ORANGE_BGR
    return image


def real(t_s: float = 1.0, seq: int = 4, **more: Any) -> CameraReading:
    image = np.full((HEIGHT, WIDTH, 3), BLUE_BGR, np.uint8)
    made = CameraReading(t_s, t_s + 0.06, seq, "real", image, CAMERA)
    return replace(made, **more)


def twin(t_s: float = 1.0, seq: int = 9, source: Source = "twin", **more: Any) -> CameraReading:
    made = CameraReading(t_s, t_s, seq, source, gate_picture(), CAMERA)
    return replace(made, **more)


def test_the_gate_stands_in_the_real_picture_and_no_blue_shines_through() -> None:
    mixed = mixer().mix(real(), twin(), now_s=1.1)
    assert mixed.reading is not None
    image = mixed.reading.image_bgr
    assert (image[10:30, 20:25] == ORANGE_BGR).all()
    untouched = np.ones((HEIGHT, WIDTH), bool)
    untouched[10:30, 20:25] = False
    assert (image[untouched] == BLUE_BGR).all()


def test_provenance_names_both_inputs_and_their_times() -> None:
    told = mixer().mix(real(1.0), twin(1.02), now_s=1.1, alignment="interpolated").provenance
    assert (told.real_seq, told.real_t_s, told.twin_seq, told.twin_t_s) == (4, 1.0, 9, 1.02)
    assert told.skew_ms == pytest.approx(20.0)
    assert told.latency_ms == pytest.approx(100.0)
    assert (told.alignment, told.dropped, told.stages) == ("interpolated", None, ())


def test_a_mixture_has_the_real_images_time_and_nothing_of_the_scene() -> None:
    ids, depth = np.full((HEIGHT, WIDTH), 7, np.uint8), np.ones((HEIGHT, WIDTH), np.float32)
    knowing: dict[str, Any] = {
        "object_ids": ids,
        "depth_m": depth,
        "camera_pose": Pose((1.0, 2.0, 3.0)),
    }
    mixed = mixer().mix(real(**knowing), twin(1.03, **knowing), now_s=1.1).reading
    assert mixed is not None
    assert (mixed.source, mixed.t_s, mixed.arrived_s, mixed.seq) == ("mixed", 1.0, 1.1, 4)
    assert mixed.object_ids is None
    assert mixed.depth_m is None
    assert mixed.camera_pose is None


@pytest.mark.parametrize(("twin_t_s", "dropped"), [(1.06, None), (0.9399, "stale"), (1.5, "stale")])
def test_an_overlay_too_far_in_time_is_not_drawn(twin_t_s: float, dropped: str | None) -> None:
    one = mixer()
    mixed = one.mix(real(1.0), twin(twin_t_s), now_s=1.6)
    assert mixed.provenance.dropped == dropped
    assert mixed.provenance.skew_ms == pytest.approx(abs(twin_t_s - 1.0) * 1000)
    assert mixed.reading is not None
    assert (mixed.reading.image_bgr == BLUE_BGR).all() == (dropped is not None)


def test_the_last_overlay_is_not_held() -> None:
    one = mixer()
    held = twin(1.0)
    shown = []
    for step in range(5):
        t_s = 1.0 + step / 30
        mixed = one.mix(real(t_s), held, now_s=t_s).reading
        assert mixed is not None
        shown.append(bool((mixed.image_bgr[10:30, 20:25] == ORANGE_BGR).all()))
    assert shown == [True, True, False, False, False]
    assert one.counts() == MixCounts(frames=5, mixed=2, dropped=(("stale", 3),))


def test_without_a_twin_the_real_picture_passes_and_is_counted() -> None:
    one = mixer()
    mixed = one.mix(real(), None, now_s=1.1)
    assert mixed.reading is not None
    assert mixed.reading.source == "mixed"
    assert (mixed.reading.image_bgr == BLUE_BGR).all()
    assert (mixed.provenance.dropped, mixed.provenance.skew_ms) == ("no_twin", None)
    assert one.counts().dropped == (("no_twin", 1),)


def test_nothing_is_shown_without_a_real_picture() -> None:
    one = mixer()
    mixed: MixedReading[CameraReading] = one.mix(None, twin(), now_s=1.1)
    assert mixed.reading is None
    assert (mixed.provenance.dropped, mixed.provenance.latency_ms) == ("no_real", None)
    assert one.mix(None, None, now_s=1.2).reading is None
    assert one.counts() == MixCounts(frames=2, mixed=0, dropped=(("no_real", 2),))


def test_a_smaller_twin_is_scaled_to_the_real_picture() -> None:
    small = np.full((24, 32, 3), (90, 90, 90), np.uint8)
    small[5:15, 10:20] = ORANGE_BGR
    half = twin(image_bgr=small, intrinsics=Intrinsics.from_fov(32, 24, 1.2))
    mixed = mixer().mix(real(), half, now_s=1.1)
    assert mixed.provenance.dropped is None
    assert mixed.reading is not None
    assert (mixed.reading.image_bgr[14:26, 24:36] == ORANGE_BGR).all()
    assert (mixed.reading.image_bgr[:8] == BLUE_BGR).all()


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ({"image_bgr": np.zeros((HEIGHT, WIDTH), np.uint8)}, "bad_twin"),
        ({"image_bgr": np.zeros((HEIGHT, WIDTH, 3), np.float32)}, "bad_twin"),
        ({"image_bgr": np.zeros((HEIGHT, WIDTH - 1, 3), np.uint8)}, "bad_twin"),
        ({"t_s": float("nan")}, "bad_twin"),
        ({"intrinsics": Intrinsics.from_fov(WIDTH, HEIGHT, 1.0)}, "mismatch"),
    ],
)
def test_a_bad_twin_never_makes_a_wrong_picture(bad: dict[str, Any], reason: str) -> None:
    mixed = mixer().mix(real(), twin(**bad), now_s=1.1)
    assert mixed.provenance.dropped == reason
    assert mixed.provenance.detail
    assert mixed.reading is not None
    assert (mixed.reading.image_bgr == BLUE_BGR).all()


def test_a_bad_real_picture_is_not_shown() -> None:
    mixed = mixer().mix(real(t_s=float("inf")), twin(), now_s=1.1)
    assert mixed.reading is None
    assert mixed.provenance.dropped == "bad_real"


def test_a_filter_may_work_on_the_real_side() -> None:
    body = "filter: [{isolate_color: {name: blue, on: real}}], merge: {overlay: [real, twin]}"
    view = real()
    view.image_bgr[:20] = (90, 90, 90)
    mixed = mixer(body).mix(view, twin(), now_s=1.1).reading
    assert mixed is not None
    assert np.array_equal(mixed.image_bgr[:20], gate_picture()[:20])
    assert (mixed.image_bgr[20:] == BLUE_BGR).all()


def test_a_returned_mixture_does_not_change_with_the_next_frame() -> None:
    one = mixer()
    first = one.mix(real(), twin(), now_s=1.1).reading
    assert first is not None
    before = first.image_bgr.copy()
    one.mix(real(image_bgr=np.zeros((HEIGHT, WIDTH, 3), np.uint8)), twin(), now_s=1.2)
    assert np.array_equal(first.image_bgr, before)


def test_the_request_for_the_twins_pose_and_what_its_picture_needs() -> None:
    assert mixer().pose_request == PoseRequest("real", "interpolate", 0.1)
    assert mixer("merge: {overlay: [twin, real]}").pose_request is None
    assert mixer().needs == frozenset()
    by_id = mixer("filter: [{isolate_objects: [gate]}], merge: {overlay: [twin, real]}")
    assert by_id.needs == {"ids"}
    assert (by_id.sensor, by_id.publish) == ("camera", ("real", "twin"))


def test_durations_are_measured_only_with_a_clock() -> None:
    ticks = iter(range(100))
    told = mixer(stopwatch=lambda: float(next(ticks))).mix(real(), twin(), now_s=1.1).provenance
    assert [(stage.step, stage.duration_s) for stage in told.stages] == [
        ("resize", 1.0),
        ("isolate_color", 1.0),
        ("overlay", 1.0),
    ]


def test_an_error_of_a_step_names_file_line_step_and_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    one = mixer()
    one.mix(real(), twin(), now_s=1.1)

    def broken(*_: object) -> CameraReading:
        raise RuntimeError("the step's own fault")

    monkeypatch.setattr(one, "_merging", replace(one._merging, merge=broken))
    with pytest.raises(StepError, match=r"^r.yaml:3: step overlay, frame 1: RuntimeError: .* own"):
        one.mix(real(), twin(), now_s=1.1)
