"""A detector small enough to be made in a test: ONNX bytes, written by hand (onnx.proto3).

Its input is (1, 3, 32, 32), red first. It looks at the four quadrants: a candidate each, 16 px
wide, whose scores for the classes "red" and "green" are the mean of that colour.
"""

import struct
from typing import Literal

import numpy as np

INPUT_PX = 32
NAMES = ("red", "green")
REDDER = (1.0, 0.0, -1.0)
FLOAT, INT64, INTS = 1, 7, 7


def varint(number: int) -> bytes:
    out = bytearray()
    while True:
        number, low = number >> 7, number & 0x7F
        out.append(low | (0x80 if number else 0))
        if not number:
            return bytes(out)


def number(key: int, value: int) -> bytes:
    return varint(key << 3) + varint(value)


def chunk(key: int, value: bytes | str) -> bytes:
    raw = value.encode() if isinstance(value, str) else value
    return varint(key << 3 | 2) + varint(len(raw)) + raw


def tensor(name: str, values: np.ndarray) -> bytes:
    kind = FLOAT if values.dtype == np.float32 else INT64
    dims = b"".join(number(1, size) for size in values.shape)
    return dims + number(2, kind) + chunk(8, name) + chunk(9, values.tobytes())


def value(name: str, *shape: int) -> bytes:
    dims = b"".join(chunk(1, number(1, size)) for size in shape)
    return chunk(1, name) + chunk(2, chunk(1, number(1, FLOAT) + chunk(2, dims)))


def ints(name: str, *values: int) -> bytes:
    return chunk(5, chunk(1, name) + b"".join(number(8, one) for one in values) + number(20, INTS))


def node(kind: str, inputs: list[str], output: str, attributes: bytes = b"") -> bytes:
    named = b"".join(chunk(1, one) for one in inputs)
    return named + chunk(2, output) + chunk(3, output) + chunk(4, kind) + attributes


def tiny_detector(
    layout: Literal["v5", "v8", "end2end"], names: str = "", *, masks: bool = False
) -> bytes:
    """Return the bytes of an ONNX file; names: as the metadata of Ultralytics states them.

    masks: with prototypes of instance segmentation, the three colours of 4 x 4 pixels each, and
    coefficients by which what is redder than blue is of the object.
    """
    rows, bias = _head(layout, REDDER if masks else ())
    extra = len(REDDER) if masks else 0
    shape = {"v5": (1, 4, 7 + extra), "v8": (1, 6 + extra, 4), "end2end": (1, 4, 6 + extra)}[layout]
    half = INPUT_PX // 2
    nodes: tuple[bytes, ...] = (
        node(
            "AveragePool",
            ["images"],
            "pooled",
            ints("kernel_shape", half, half) + ints("strides", half, half),
        ),
        node("Reshape", ["pooled", "flat"], "row"),
        node("MatMul", ["row", "weights"], "product"),
        node("Add", ["product", "bias"], "sum"),
        node("Reshape", ["sum", "shape"], "output0"),
    )
    if masks:
        quarter = ints("kernel_shape", 4, 4) + ints("strides", 4, 4)
        nodes += (node("AveragePool", ["images"], "output1", quarter),)
    graph = (
        b"".join(chunk(1, one) for one in nodes)
        + chunk(2, "tiny")
        + chunk(5, tensor("flat", np.array([1, 12], np.int64)))
        + chunk(5, tensor("weights", rows))
        + chunk(5, tensor("bias", bias))
        + chunk(5, tensor("shape", np.array(shape, np.int64)))
        + chunk(11, value("images", 1, 3, INPUT_PX, INPUT_PX))
        + chunk(12, value("output0", *shape))
    )
    graph += chunk(12, value("output1", 1, 3, INPUT_PX // 4, INPUT_PX // 4)) if masks else b""
    opset = chunk(1, "") + number(2, 13)
    stated = chunk(14, chunk(1, "author") + chunk(2, "us"))
    stated += chunk(14, chunk(1, "names") + chunk(2, names)) if names else b""
    return number(1, 8) + chunk(7, graph) + chunk(8, opset) + stated


def _head(layout: str, coefficients: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return weights (12, outputs) and bias (1, outputs) of the last layer."""
    features = {"v5": 7, "v8": 6, "end2end": 6}[layout] + len(coefficients)
    weights, bias = np.zeros((12, 4, features), np.float32), np.zeros((4, features), np.float32)
    for quadrant in range(4):
        x, y = quadrant % 2 * 16.0, quadrant // 2 * 16.0
        bias[quadrant, features - len(coefficients) :] = coefficients
        if layout == "end2end":
            bias[quadrant, :4] = (x, y, x + 16, y + 16)
            weights[quadrant, quadrant, 4] = 1.0
            continue
        bias[quadrant, :4] = (x + 8, y + 8, 16, 16)
        first = 5 if layout == "v5" else 4
        if layout == "v5":
            bias[quadrant, 4] = 0.9
        weights[quadrant, quadrant, first] = 1.0
        weights[4 + quadrant, quadrant, first + 1] = 1.0
    if layout == "v8":
        weights, bias = weights.transpose(0, 2, 1), bias.T
    return (
        np.ascontiguousarray(weights.reshape(12, -1)),
        np.ascontiguousarray(bias.reshape(1, -1)),
    )


def truncated() -> bytes:
    """Return the beginning of a detector's file."""
    whole = tiny_detector("v8")
    return whole[: len(whole) // 2]


def noise() -> bytes:
    """Return bytes that are nothing."""
    return struct.pack("<64I", *range(0xDEAD, 0xDEAD + 64))
