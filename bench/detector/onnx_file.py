"""The trained network as an ONNX file (onnx.proto3) with the output of the YOLO family's v8 layout.

Input `images` (1, 3, height, width), red first, 0 to 1. Output `output0` (1, 4 + CLASSES, cells):
the centre, width and height in pixels of the input, and a score for each class.
"""

import numpy as np

from bench.detector.network import BOX_PX, CLASSES, LAYERS, STRIDE_PX, Network

_FLOAT, _INT64 = 1, 7
_INT, _INTS = 2, 7


def onnx_bytes(network: Network, width_px: int, height_px: int) -> bytes:
    """Return the file of a network for one size of input."""
    rows, columns = height_px // STRIDE_PX, width_px // STRIDE_PX
    nodes, tensors, value = [], [], "images"
    for index, layer in enumerate(LAYERS):
        # The network was trained on blue first; the file is asked with red first.
        weights = network.weights[index].transpose(3, 2, 0, 1)
        weights = weights[:, ::-1] if index == 0 else weights
        tensors += [_tensor(f"w{index}", weights), _tensor(f"b{index}", network.biases[index])]
        settings = _ints("kernel_shape", layer.size, layer.size)
        settings += _ints("strides", layer.stride, layer.stride)
        settings += _ints("dilations", layer.dilation, layer.dilation)
        settings += _ints("pads", *(layer.pad,) * 4)
        made = f"c{index}"
        nodes.append(_node("Conv", [value, f"w{index}", f"b{index}"], made, settings))
        value = made
        if index < len(LAYERS) - 1:
            nodes.append(_node("Relu", [value], f"r{index}"))
            value = f"r{index}"
    cells = rows * columns
    y, x = np.meshgrid(np.arange(rows) + 0.5, np.arange(columns) + 0.5, indexing="ij")
    middles = np.stack([x.ravel(), y.ravel()])[None].astype(np.float32) * STRIDE_PX
    tensors += [
        _tensor("flat", np.array([1, 4 + CLASSES, cells], np.int64)),
        _tensor("stride", np.full((1, 2, 1), STRIDE_PX, np.float32)),
        _tensor("side", np.full((1, 2, 1), BOX_PX, np.float32)),
        _tensor("middles", middles),
    ]
    nodes += [
        _node("Reshape", [value, "flat"], "rows"),
        *_slice("rows", "offset", 0, 2, tensors),
        *_slice("rows", "logs", 2, 4, tensors),
        *_slice("rows", "logits", 4, 4 + CLASSES, tensors),
        _node("Mul", ["offset", "stride"], "shift"),
        _node("Add", ["shift", "middles"], "centre"),
        _node("Exp", ["logs"], "times"),
        _node("Mul", ["times", "side"], "size"),
        _node("Sigmoid", ["logits"], "scores"),
        _node("Concat", ["centre", "size", "scores"], "output0", _int("axis", 1)),
    ]
    graph = b"".join(_chunk(1, node) for node in nodes) + _chunk(2, "detector")
    graph += b"".join(_chunk(5, tensor) for tensor in tensors)
    graph += _chunk(11, _value("images", 1, 3, height_px, width_px))
    graph += _chunk(12, _value("output0", 1, 4 + CLASSES, cells))
    opset = _chunk(1, "") + _number(2, 13)
    return _number(1, 8) + _chunk(7, graph) + _chunk(8, opset)


def read_weights(network: Network, file: bytes) -> None:
    """Give a network the weights of a file that `onnx_bytes` made of one like it."""
    for index in range(len(LAYERS)):
        kernel = network.weights[index]
        stored = _stored(file, f"w{index}", kernel.size).reshape(kernel.transpose(3, 2, 0, 1).shape)
        stored = stored[:, ::-1] if index == 0 else stored
        kernel[:] = stored.transpose(2, 3, 1, 0)
        network.biases[index][:] = _stored(file, f"b{index}", network.biases[index].size)


def _stored(file: bytes, name: str, count: int) -> np.ndarray:
    """Return the numbers of a tensor of the file, flat."""
    marks = _chunk(8, name) + _varint(9 << 3 | 2) + _varint(4 * count)
    return np.frombuffer(file, np.float32, count, file.index(marks) + len(marks))


def _slice(value: str, made: str, first: int, last: int, tensors: list[bytes]) -> list[bytes]:
    names = [f"{made}_{part}" for part in ("from", "to", "axis")]
    for name, number in zip(names, (first, last, 1), strict=True):
        tensors.append(_tensor(name, np.array([number], np.int64)))
    return [_node("Slice", [value, *names], made)]


def _varint(number: int) -> bytes:
    out = bytearray()
    while True:
        number, low = number >> 7, number & 0x7F
        out.append(low | (0x80 if number else 0))
        if not number:
            return bytes(out)


def _number(key: int, value: int) -> bytes:
    return _varint(key << 3) + _varint(value)


def _chunk(key: int, value: bytes | str) -> bytes:
    raw = value.encode() if isinstance(value, str) else value
    return _varint(key << 3 | 2) + _varint(len(raw)) + raw


def _tensor(name: str, values: np.ndarray) -> bytes:
    kind = _FLOAT if values.dtype == np.float32 else _INT64
    dims = b"".join(_number(1, size) for size in values.shape)
    return dims + _number(2, kind) + _chunk(8, name) + _chunk(9, values.tobytes())


def _value(name: str, *shape: int) -> bytes:
    dims = b"".join(_chunk(1, _number(1, size)) for size in shape)
    return _chunk(1, name) + _chunk(2, _chunk(1, _number(1, _FLOAT) + _chunk(2, dims)))


def _ints(name: str, *values: int) -> bytes:
    return _chunk(5, _chunk(1, name) + b"".join(_number(8, v) for v in values) + _number(20, _INTS))


def _int(name: str, value: int) -> bytes:
    return _chunk(5, _chunk(1, name) + _number(3, value) + _number(20, _INT))


def _node(kind: str, inputs: list[str], output: str, attributes: bytes = b"") -> bytes:
    named = b"".join(_chunk(1, one) for one in inputs)
    return named + _chunk(2, output) + _chunk(3, output) + _chunk(4, kind) + attributes
