"""Missing reference pictures are found by their numbers."""

from fractions import Fraction
from typing import Any

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.plugins.cameras.av_grabber import LossFinder


def stream(count: int, profile: str = "baseline", **options: str) -> list[bytes]:
    """Return the access units of a moving picture, in order of decoding."""
    codec: Any = av.CodecContext.create("libx264", "w")
    codec.width, codec.height, codec.pix_fmt = 64, 48, "yuv420p"
    codec.time_base, codec.framerate = Fraction(1, 30), Fraction(30)
    codec.thread_count = 1
    codec.options = {"profile": profile, "g": "12", **options}
    units = []
    for k in range(count):
        rows, columns = np.mgrid[0:72, 0:64]
        moving = (3 * rows + 2 * columns + 5 * k).astype(np.uint8)
        frame = av.VideoFrame.from_ndarray(moving, format="yuv420p")
        frame.pts = k
        units += [bytes(packet) for packet in codec.encode(frame)]
    return units + [bytes(packet) for packet in codec.encode(None)]


PLAIN = stream(40, tune="zerolatency", preset="ultrafast")


@pytest.mark.parametrize(
    ("profile", "options"),
    [
        ("baseline", {"tune": "zerolatency", "preset": "ultrafast"}),
        ("high", {"bf": "3", "x264-params": "scenecut=0:b-adapt=0"}),
        (
            "high",
            {"bf": "2", "x264-params": "bframes=3:scenecut=0:b-adapt=0:b-pyramid=none:slices=4"},
        ),
        ("high", {"x264-params": "cqm=jvt:scenecut=0:b-adapt=0:bframes=2"}),
        ("high", {"tune": "zerolatency", "preset": "ultrafast", "g": "1000"}),
    ],
)
def test_a_whole_stream_has_no_loss(profile: str, options: dict[str, str]) -> None:
    finder = LossFinder()
    assert [finder.lost_before(unit) for unit in stream(40, profile, **options)] == [False] * 40


@pytest.mark.parametrize("lost", [1, 5, 11, 13, 25])
def test_one_lost_picture_is_found_at_the_next(lost: int) -> None:
    finder = LossFinder()
    found = [finder.lost_before(unit) for k, unit in enumerate(PLAIN) if k != lost]
    next_is_key = (lost + 1) % 12 == 0
    assert found.index(True) == lost if not next_is_key else not any(found)
    assert sum(found) == (0 if next_is_key else 1)


def test_a_lost_picture_on_which_no_other_builds_is_no_loss() -> None:
    units = stream(40, "high", bf="2", **{"x264-params": "scenecut=0:b-adapt=0:b-pyramid=none"})
    nobody_needs = [k for k, unit in enumerate(units) if slice_header(unit) & 0x60 == 0]
    assert nobody_needs
    finder = LossFinder()
    kept = [unit for k, unit in enumerate(units) if k != nobody_needs[0]]
    assert not any(finder.lost_before(unit) for unit in kept)


def slice_header(unit: bytes) -> int:
    parts = unit.replace(b"\0\0\0\1", b"\0\0\1").split(b"\0\0\1")
    return next(part[0] for part in parts if part and part[0] & 0x1F in {1, 5})


@given(st.binary(max_size=300))
def test_garbage_is_no_loss_and_no_crash(data: bytes) -> None:
    finder = LossFinder()
    finder.lost_before(PLAIN[0])
    assert finder.lost_before(b"\0\0\1" + data) in {True, False}
    assert LossFinder().lost_before(data) is False


@given(cut=st.integers(0, 200), flip=st.integers(0, 100))
def test_broken_units_do_no_harm(cut: int, flip: int) -> None:
    unit = bytearray(PLAIN[0][: max(1, len(PLAIN[0]) - cut)])
    unit[flip % len(unit)] ^= 0xFF
    finder = LossFinder()
    finder.lost_before(bytes(unit))
    finder.lost_before(PLAIN[1])
