"""Pictures as bytes, there and back; and bytes that are none."""

import struct
from contextlib import suppress

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.plugins.readings.messagepack import BadMessageError
from wil_campaign.plugins.simulator.image_parts import (
    compressed_size,
    decode_depth_part,
    decode_ids_part,
    decode_image_part,
    encode_depth_part,
    encode_ids_part,
    encode_image_part,
)

SIZE = (16, 12)
RNG = np.random.default_rng(3)
IMAGE = RNG.integers(0, 256, (12, 16, 3), np.uint8)
DEPTH = RNG.uniform(0.5, 20.0, (12, 16)).astype(np.float32)
DEPTH[0] = np.inf
IDS = RNG.integers(0, 5, (12, 16), np.uint8)


@pytest.mark.parametrize("encoding", ["bgr8", "png"])
def test_images_come_back_as_they_were(encoding: str) -> None:
    data = encode_image_part(IMAGE, encoding)
    assert np.array_equal(decode_image_part(data, encoding, SIZE), IMAGE)


def test_jpeg_comes_back_nearly() -> None:
    smooth = cv2.resize(IMAGE[:2, :2], SIZE)
    data = encode_image_part(smooth, "jpeg", jpeg_quality=95)
    found = decode_image_part(data, "jpeg", SIZE)
    assert np.abs(found.astype(int) - smooth.astype(int)).mean() < 6


def test_rgb_is_turned_into_bgr() -> None:
    data = np.ascontiguousarray(IMAGE[..., ::-1]).tobytes()
    assert np.array_equal(decode_image_part(data, "rgb8", SIZE), IMAGE)


def test_decoded_arrays_belong_to_the_caller() -> None:
    for array in (
        decode_image_part(encode_image_part(IMAGE, "bgr8"), "bgr8", SIZE),
        decode_depth_part(encode_depth_part(DEPTH), "f32", SIZE),
        decode_ids_part(encode_ids_part(IDS), "u8", SIZE),
    ):
        assert array.flags.writeable
        assert array.flags.c_contiguous


def test_depth_and_ids_come_back() -> None:
    assert np.array_equal(decode_depth_part(encode_depth_part(DEPTH), "f32", SIZE), DEPTH)
    assert np.array_equal(decode_ids_part(encode_ids_part(IDS), "u8", SIZE), IDS)
    png = cv2.imencode(".png", IDS)[1].tobytes()
    assert np.array_equal(decode_ids_part(png, "png8", SIZE), IDS)


@pytest.mark.parametrize("encoding", ["u16_mm", "png16_mm"])
def test_depth_in_millimetres(encoding: str) -> None:
    millimetres = np.where(np.isinf(DEPTH), 0, DEPTH * 1000).astype("<u2")
    data = millimetres.tobytes()
    if encoding == "png16_mm":
        data = cv2.imencode(".png", millimetres)[1].tobytes()
    found = decode_depth_part(data, encoding, SIZE)
    assert np.array_equal(np.isinf(found), np.isinf(DEPTH))
    seen = np.isfinite(DEPTH)
    assert np.abs(found[seen] - DEPTH[seen]).max() < 0.0011


def with_value(value: float) -> bytes:
    depth = DEPTH.copy()
    depth[5, 5] = value
    return depth.tobytes()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (with_value(float("nan")), "1 values that are NaN"),
        (with_value(-1.0), r"-1\.0 m"),
        (with_value(1.0)[:-1], "767 bytes, an array of .* has 768"),
        (DEPTH.astype(np.float64).tobytes(), "1536 bytes"),
        (b"", "0 bytes"),
    ],
)
def test_wrong_depth_is_refused(data: bytes, words: str) -> None:
    with pytest.raises(BadMessageError, match=words):
        decode_depth_part(data, "f32", SIZE)


def test_a_picture_of_another_size_is_refused() -> None:
    for encoding in ("bgr8", "png", "jpeg"):
        with pytest.raises(BadMessageError, match=r"bytes|16x12, not 12x16"):
            decode_image_part(
                encode_image_part(IMAGE, encoding),
                encoding,
                (12, 16) if encoding != "bgr8" else (16, 11),
            )


def test_a_picture_of_another_kind_is_refused() -> None:
    grey16 = cv2.imencode(".png", IMAGE[..., 0].astype(np.uint16))[1].tobytes()
    colour = cv2.imencode(".png", IMAGE)[1].tobytes()
    with pytest.raises(BadMessageError, match="channels"):
        decode_ids_part(grey16, "png8", SIZE)
    with pytest.raises(BadMessageError, match="channels"):
        decode_depth_part(colour, "png16_mm", SIZE)
    with pytest.raises(BadMessageError, match="encoding 'bmp'"):
        decode_image_part(colour, "bmp", SIZE)
    with pytest.raises(BadMessageError, match="encoding 'f64'"):
        decode_depth_part(b"", "f64", SIZE)
    with pytest.raises(ValueError, match="choose"):
        encode_image_part(IMAGE, "rgb8")


def test_a_few_bytes_that_announce_a_huge_picture_are_not_decoded() -> None:
    png = bytearray(cv2.imencode(".png", IMAGE)[1].tobytes())
    png[16:24] = struct.pack(">II", 60_000, 60_000)
    assert compressed_size(bytes(png)) == (60_000, 60_000)
    with pytest.raises(BadMessageError, match="60000x60000"):
        decode_image_part(bytes(png), "png", SIZE)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("shape", [(1, 1, 3), (48, 640, 3), (300, 20, 3)])
def test_announced_sizes_are_read(suffix: str, shape: tuple[int, int, int]) -> None:
    data = cv2.imencode(suffix, np.zeros(shape, np.uint8))[1].tobytes()
    assert compressed_size(data) == (shape[1], shape[0])


@given(st.binary(max_size=100), st.sampled_from([b"", b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"]))
def test_garbage_is_refused_in_every_encoding(data: bytes, start: bytes) -> None:
    for encoding in ("bgr8", "rgb8", "jpeg", "png", data.decode("latin1")):
        with pytest.raises(BadMessageError):
            decode_image_part(start + data, encoding, SIZE)
    with pytest.raises(BadMessageError):
        decode_ids_part(start + data, "png8", SIZE)


@given(at=st.integers(30, 400), value=st.integers(0, 255))
def test_a_damaged_file_is_refused_or_has_the_right_size(at: int, value: int) -> None:
    data = bytearray(encode_image_part(IMAGE, "jpeg"))
    data[at % len(data)] = value
    with suppress(BadMessageError):
        assert decode_image_part(bytes(data), "jpeg", SIZE).shape == (12, 16, 3)
