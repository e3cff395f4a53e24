"""The ONNX detector: every layout, boxes where the picture shows them, and files that are none."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vehicles.tiny_onnx import INPUT_PX, NAMES, noise, tiny_detector, truncated
from wil_campaign.plugins.detector import network_trial
from wil_campaign.plugins.detector.detector import (
    DetectorCandidates,
    DetectorError,
    OnnxDetector,
    decoded_candidates,
    letterboxed_image,
    surest_candidates,
)
from wil_campaign.plugins.detector.onnx_names import class_names

Kind = Literal["v5", "v8", "end2end"]


def detector(folder: Path, kind: Kind, **options: Any) -> OnnxDetector:
    path = folder / f"{kind}.onnx"
    path.write_bytes(tiny_detector(kind))
    return OnnxDetector(path, names=NAMES, input_px=(INPUT_PX, INPUT_PX), **options)


def picture(width: int = 64, height: int = 64) -> Any:
    """Red top left, green bottom right."""
    image = np.zeros((height, width, 3), np.uint8)
    image[: height // 2, : width // 2] = (0, 0, 255)
    image[height // 2 :, width // 2 :] = (0, 255, 0)
    return image


@pytest.mark.parametrize("layout", ["v5", "v8"])
@pytest.mark.parametrize("told", [True, False])
def test_both_layouts_find_the_objects_in_an_image(
    tmp_path: Path, layout: Kind, told: bool
) -> None:
    found = detector(tmp_path, layout, layout=layout if told else "auto").detect(picture())
    boxes = {(one.name, one.left_px, one.top_px, one.right_px, one.bottom_px) for one in found}
    assert boxes == {("red", 0, 0, 32, 32), ("green", 32, 32, 64, 64)}
    assert all(one.score == pytest.approx(0.9 if layout == "v5" else 1.0) for one in found)


def test_the_end_to_end_layout(tmp_path: Path) -> None:
    (one,) = detector(tmp_path, "end2end", layout="end2end").detect(picture())
    assert (one.name, one.left_px, one.bottom_px, one.score) == ("red", 0, 32, 1.0)


def test_boxes_of_a_wide_picture_are_not_those_of_the_letterbox(tmp_path: Path) -> None:
    """A picture twice as wide fills the middle half: the top quadrants see its upper half."""
    image = np.zeros((32, 64, 3), np.uint8)
    image[:16, :32] = (0, 0, 255)
    found = detector(tmp_path, "v8", threshold=0.6).detect(image)
    (one,) = [each for each in found if each.name == "red"]
    # Half of that quadrant is the grey of the letterbox; the box is cut at the picture's top.
    assert one.score == pytest.approx(0.5 + 0.5 * 114 / 255, abs=0.01)
    assert (one.left_px, one.top_px, one.right_px, one.bottom_px) == (0, 0, 32, 16)


@given(st.integers(1, 300), st.integers(1, 300))
def test_a_letterbox_keeps_the_shape(width: int, height: int) -> None:
    laid, how = letterboxed_image(np.zeros((height, width, 3), np.uint8), (64, 48))
    assert laid.shape == (48, 64, 3)
    assert width * how.scale <= 64 + 1e-9
    assert height * how.scale <= 48 + 1e-9
    assert how.left_px == 0 or how.top_px == 0


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (noise(), "not an ONNX network"),
        (truncated(), "not an ONNX network|empty"),
        (b"", "not an ONNX|empty"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:4d\n", "a pointer of Git LFS"),
    ],
)
def test_a_file_that_is_no_detector(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "bad.onnx"
    path.write_bytes(content)
    with pytest.raises(DetectorError, match=said):
        OnnxDetector(path, names=NAMES)


def test_a_file_that_is_missing_and_an_input_that_does_not_fit(tmp_path: Path) -> None:
    with pytest.raises(DetectorError, match=r"no file 'none\.onnx'"):
        OnnxDetector(tmp_path / "none.onnx", names=NAMES)
    path = detector(tmp_path, "v8")._path
    with pytest.raises(DetectorError, match=r"'v8\.onnx' cannot run on \(48, 48\): "):
        OnnxDetector(path, names=NAMES, input_px=(48, 48))


def test_a_network_that_takes_too_much_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = detector(tmp_path, "v8")._path
    monkeypatch.setattr(network_trial, "_SPARE_MB", 20.0)
    with pytest.raises(DetectorError, match=r"cannot run on \(4096, 4096\): .*([Mm]emory|alloc)"):
        OnnxDetector(path, names=NAMES, input_px=(4096, 4096))
    monkeypatch.setattr(network_trial, "MAX_NETWORK_BYTES", 10)
    with pytest.raises(DetectorError, match="bytes; at most 10 are read"):
        OnnxDetector(path, names=NAMES, input_px=(64, 64))


STATED = "{0: 'red', 1: 'green'}"


@pytest.mark.parametrize(
    ("stated", "given", "names"),
    [
        (STATED, (), ("red", "green")),
        ("['red', 'green']", (), ("red", "green")),
        (STATED, ("red", "green"), ("red", "green")),
        (STATED, ("rot", "green"), ("rot", "green")),
        ("", ("green", "red"), ("green", "red")),
        ("{0: 'red', 2: 'green'}", ("a", "b"), ("a", "b")),
        ("__import__('os')", ("a", "b"), ("a", "b")),
    ],
)
def test_the_file_may_state_its_classes(
    tmp_path: Path, stated: str, given: tuple[str, ...], names: tuple[str, ...]
) -> None:
    path = tmp_path / "named.onnx"
    path.write_bytes(tiny_detector("v8", stated))
    assert OnnxDetector(path, names=given, input_px=(INPUT_PX, INPUT_PX)).names == names


@pytest.mark.parametrize(
    ("stated", "given", "said"),
    [
        (STATED, ("green", "red"), r"has the classes red, green: class 0 is 'red', and 'green' in"),
        (STATED, ("red",), r"has the classes red, green \(2\), and names has 1; name all of them"),
        ("", (), "'named.onnx' does not state its classes; give names, in order"),
        ("", ("person", "bicycle", "car"), r"unknown layout for 3 classes"),
    ],
)
def test_names_that_contradict_the_file_are_refused(
    tmp_path: Path, stated: str, given: tuple[str, ...], said: str
) -> None:
    """They were swapped without a word, and docs/detector.md named three of 80 classes."""
    path = tmp_path / "named.onnx"
    path.write_bytes(tiny_detector("v8", stated))
    with pytest.raises(DetectorError, match=said):
        OnnxDetector(path, names=given, input_px=(INPUT_PX, INPUT_PX))


@pytest.mark.parametrize("content", [noise(), truncated(), b"", b"\x72\x05\x0a\x7f", b"\x72\xff"])
def test_a_damaged_file_states_no_classes(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad.onnx").write_bytes(content)
    assert class_names(tmp_path / "bad.onnx") == ()


def test_an_output_of_too_few_names_says_how_many_classes_there_are() -> None:
    with pytest.raises(DetectorError, match="for 3 classes; as v8 it has 80 classes: name all"):
        decoded_candidates(np.zeros((1, 84, 8400), np.float32), 3, "auto")
    with pytest.raises(DetectorError, match="for 3 classes; as v5 it has 80 classes: name all"):
        decoded_candidates(np.zeros((1, 25200, 85), np.float32), 3, "auto")


@pytest.mark.parametrize(
    ("shape", "classes", "layout"),
    [((1, 9, 9), 2, "auto"), ((4, 6), 2, "auto"), ((1, 4, 7), 3, "v5"), ((2, 6, 4), 2, "v8")],
)
def test_an_output_of_no_layout(shape: Any, classes: int, layout: Any) -> None:
    with pytest.raises(DetectorError):
        decoded_candidates(np.zeros(shape, np.float32), classes, layout)


def test_an_output_of_two_layouts_needs_the_layout_stated() -> None:
    """One class: six numbers are those of v5, and of an export with NMS."""
    row = np.array([[[10, 20, 30, 40, 0.9, 0]]], np.float32)
    with pytest.raises(DetectorError, match=r"v5 and end2end; state layout: v5 or end2end"):
        decoded_candidates(row, 1, "auto")
    assert decoded_candidates(row, 1, "end2end").boxes.tolist() == [[10, 20, 30, 40]]
    assert decoded_candidates(row, 1, "v5").boxes.tolist() == [[-5, 0, 25, 40]]


def test_an_output_of_two_layouts_is_refused_before_a_flight(tmp_path: Path) -> None:
    path = detector(tmp_path, "end2end", layout="end2end")._path
    with pytest.raises(DetectorError, match="state layout: v5 or end2end"):
        OnnxDetector(path, names=NAMES[:1], input_px=(INPUT_PX, INPUT_PX))


def test_a_class_without_a_name_is_an_error_that_says_so(tmp_path: Path) -> None:
    path = detector(tmp_path, "end2end")._path
    options: Any = {"input_px": (INPUT_PX, INPUT_PX), "layout": "end2end"}
    found = OnnxDetector(path, names=NAMES, **options)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "wil_campaign.plugins.detector.detector.decoded_candidates", _of_classes(1, 2)
        )
        with pytest.raises(DetectorError, match=r"found class 2, but has 2 names \(classes 0 to 1"):
            found.detect(picture())
        patch.setattr("wil_campaign.plugins.detector.detector.decoded_candidates", _of_classes(-1))
        with pytest.raises(DetectorError, match="found class -1"):
            found.detect(picture())


def _of_classes(*kinds: int) -> Any:
    many = len(kinds)
    boxes = np.array([[8 * k, 0, 8 * k + 4, 4] for k in range(many)], np.float32)
    given_output = DetectorCandidates(boxes, np.full(many, 0.9, np.float32), np.array(kinds))
    return lambda *_: given_output


def test_candidates_that_are_not_finite_are_left_out() -> None:
    rows = np.ones((1, 3, 7), np.float32)
    rows[0, 1, 2] = np.nan
    rows[0, 2, 0] = np.inf
    assert len(decoded_candidates(rows, 2, "v5").scores) == 1


@pytest.mark.parametrize(("layout", "shape"), [("v5", (1, 3, 7)), ("v8", (1, 6, 3))])
def test_a_network_that_gives_no_numbers_has_not_looked(
    layout: Kind, shape: tuple[int, ...]
) -> None:
    """It looked as if nothing was there."""
    with pytest.raises(DetectorError, match="no number in any candidate"):
        decoded_candidates(np.full(shape, np.nan, np.float32), 2, layout)
    assert not len(decoded_candidates(np.ones((1, 0, 7), np.float32), 2, "v5").scores)


def best(
    found: DetectorCandidates, threshold: float, overlap: float
) -> list[tuple[int, float, Any]]:
    kept = surest_candidates(found, threshold, overlap)
    return [(int(found.kinds[i]), float(found.scores[i]), found.boxes[i]) for i in kept]


@pytest.mark.parametrize("layout", ["v5", "v8", "end2end"])
@pytest.mark.parametrize("size", [(64, 64), (64, 32), (40, 80)])
def test_a_network_of_instance_segmentation_gives_masks(
    tmp_path: Path, layout: Kind, size: tuple[int, int]
) -> None:
    """Red is a disc: its mask is the disc, within the prototypes' cells, and not the box."""
    path = tmp_path / "seg.onnx"
    path.write_bytes(tiny_detector(layout, masks=True))
    network = OnnxDetector(
        path, names=NAMES, input_px=(INPUT_PX, INPUT_PX), layout=layout, threshold=0.25
    )
    wide, high = size
    v, u = np.mgrid[0:high, 0:wide]
    scale = max(size) / INPUT_PX
    centre = wide / 4, high / 2 - (5 * scale if wide == high else 0.25 * high)
    image = np.full((high, wide, 3), (255, 0, 0), np.uint8)
    disc = (u - centre[0]) ** 2 + (v - centre[1]) ** 2 < (6.5 * scale) ** 2
    image[disc] = (0, 0, 255)
    found = [one for one in network.detect(image) if one.name == "red"]
    masks = [one.mask for one in found if one.mask is not None]
    assert masks
    assert all(mask.shape == (high, wide) and mask.dtype == np.uint8 for mask in masks)
    shown = np.any([mask != 0 for mask in masks], axis=0)
    box = np.zeros_like(shown)
    for one in found:
        rows, columns = (one.top_px, one.bottom_px), (one.left_px, one.right_px)
        box[slice(*map(round, rows)), slice(*map(round, columns))] = True
    assert not (shown & ~box).any()
    wrong = (shown != disc) & box
    assert wrong.sum() <= 0.2 * (disc & box).sum()
    assert (box & ~disc).sum() > 2 * wrong.sum()


boxes = st.tuples(*[st.floats(0, 50, width=32)] * 2, *[st.floats(1, 50, width=32)] * 2)


@given(st.lists(st.tuples(boxes, st.floats(0, 1, width=32), st.integers(0, 2)), max_size=20))
def test_the_surest_of_boxes_that_cover_each_other_stays(given_boxes: Any) -> None:
    n = len(given_boxes)
    array = np.array([b for b, _, _ in given_boxes], np.float32).reshape(n, 4)
    array[:, 2:] += array[:, :2]
    scores = np.array([s for _, s, _ in given_boxes], np.float32)
    kinds = np.array([k for _, _, k in given_boxes], np.int64)
    found = best(DetectorCandidates(array, scores, kinds), 0.3, 0.5)
    assert [score for _, score, _ in found] == sorted((s for _, s, _ in found), reverse=True)
    assert all(score >= np.float32(0.3) for _, score, _ in found)

    def overlap(a: Any, b: Any) -> float:
        w = max(0.0, min(a[2], b[2]) - max(a[0], b[0])) * max(
            0.0, min(a[3], b[3]) - max(a[1], b[1])
        )
        return float(w / ((a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - w))

    for i, (kind, _, box) in enumerate(found):
        assert all(k != kind or overlap(b, box) <= 0.5 + 1e-6 for k, _, b in found[:i])
    if (scores >= 0.3).any():
        assert found[0][1] == scores.max()


def test_boxes_at_the_largest_single_are_no_overflow() -> None:
    huge = float(np.finfo(np.float32).max)
    boxes = np.array([[-huge, -huge, huge, huge]] * 2, np.float32)
    scores, kinds = np.array([0.9, 0.8], np.float32), np.array([0, 0])
    with np.errstate(all="raise"):
        found = best(DetectorCandidates(boxes, scores, kinds), 0.3, 0.5)
    assert [score for _, score, _ in found] == [pytest.approx(0.9)]
