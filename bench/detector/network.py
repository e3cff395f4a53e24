"""A small convolutional network in NumPy: forward, backward, Adam; enough to train one detector.

Arrays are (batch, height, width, channels) float32. A layer is a convolution with a stride or a
dilation and ReLU; the first cuts the image in tiles. The last is 1 x 1 and linear: for each cell of
STRIDE_PX pixels dx, dy, log width, log height and a logit for each class.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
STRIDE_PX = 16
BOX_PX = 32.0
"""A log of 0 is a box of this side."""
CLASSES = 2


@dataclass(frozen=True, slots=True)
class Layer:
    """A layer's shape. size: of the kernel; one as large as its stride cuts the image in tiles."""

    inputs: int
    outputs: int
    size: int = 3
    stride: int = 1
    dilation: int = 1

    @property
    def pad(self) -> int:
        """Return how many zeros stand round the input on each side."""
        return 0 if self.size == self.stride else self.size // 2 * self.dilation


LAYERS = (
    Layer(3, 24, size=4, stride=4),
    Layer(24, 32, stride=2),
    Layer(32, 48, stride=2),
    Layer(48, 48, dilation=2),
    Layer(48, 48, dilation=4),
    Layer(48, 48, dilation=2),
    Layer(48, 4 + CLASSES, size=1),
)


class Network:
    """Weights (size, size, inputs, outputs) and biases of LAYERS, and Adam's moments of them."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.weights: list[F32] = []
        self.biases: list[F32] = []
        for layer in LAYERS:
            fan_in = layer.size * layer.size * layer.inputs
            shape = (layer.size, layer.size, layer.inputs, layer.outputs)
            scale = np.sqrt(2.0 / fan_in) * (2.0 if layer.inputs == 3 else 1.0)
            self.weights.append((rng.standard_normal(shape) * scale).astype(np.float32))
            self.biases.append(np.zeros(layer.outputs, np.float32))
        self.weights[-1] *= 0.3
        self.biases[-1][4:] = -4.0
        self._first = [np.zeros_like(parameter) for parameter in self.parameters]
        self._second = [np.zeros_like(parameter) for parameter in self.parameters]
        self._steps = 0

    @property
    def parameters(self) -> list[F32]:
        """Return weights and biases, layer by layer; written to by `step`."""
        return [one for pair in zip(self.weights, self.biases, strict=True) for one in pair]

    def forward(self, images: F32) -> tuple[F32, list[tuple[F32, F32]]]:
        """Return the output, and what `backward` needs of each layer: patches and activation."""
        kept: list[tuple[F32, F32]] = []
        value = images
        for index, layer in enumerate(LAYERS):
            patches = _patches(value, layer)
            flat = patches.reshape(-1, patches.shape[-1])
            made = flat @ self.weights[index].reshape(-1, layer.outputs) + self.biases[index]
            if index < len(LAYERS) - 1:
                np.maximum(made, 0.0, out=made)
            value = made.reshape(*patches.shape[:3], layer.outputs)
            kept.append((flat, value))
        return value, kept

    def backward(self, kept: list[tuple[F32, F32]], gradient: F32) -> list[F32]:
        """Return the gradient of each of `parameters`, given that of the output."""
        found: list[F32] = []
        for index in range(len(LAYERS) - 1, -1, -1):
            layer, (flat, value) = LAYERS[index], kept[index]
            if index < len(LAYERS) - 1:
                gradient = gradient * (value > 0.0)
            rows = gradient.reshape(-1, layer.outputs)
            weights = self.weights[index]
            found += [rows.sum(axis=0), (flat.T @ rows).reshape(weights.shape)]
            if index:
                before = kept[index - 1][1].shape
                columns = rows @ weights.reshape(-1, layer.outputs).T
                gradient = _spread(columns.reshape(*gradient.shape[:3], -1), layer, before)
        return found[::-1]

    def step(self, gradients: list[F32], rate: float, decay: float = 1e-4) -> None:
        """Move the parameters by Adam with decoupled weight decay."""
        self._steps += 1
        for index, (parameter, gradient) in enumerate(zip(self.parameters, gradients, strict=True)):
            self._first[index] += 0.1 * (gradient - self._first[index])
            self._second[index] += 0.001 * (gradient * gradient - self._second[index])
            mean = self._first[index] / (1.0 - 0.9**self._steps)
            square = self._second[index] / (1.0 - 0.999**self._steps)
            change = rate * mean / (np.sqrt(square) + 1e-7)
            if parameter.ndim > 1:
                change += rate * decay * parameter
            np.subtract(parameter, change, out=parameter)


def _patches(value: F32, layer: Layer) -> F32:
    """Return what each output cell sees: (batch, rows, columns, size * size * inputs)."""
    batch, rows, columns, depth = value.shape
    if layer.size == layer.stride:
        down, across = rows // layer.size, columns // layer.size
        tiles = value.reshape(batch, down, layer.size, across, layer.size, depth)
        return tiles.transpose(0, 1, 3, 2, 4, 5).reshape(batch, down, across, -1)
    pad, size = layer.pad, layer.size
    padded = np.pad(value, ((0, 0), (pad, pad), (pad, pad), (0, 0)))
    down, across = -(-rows // layer.stride), -(-columns // layer.stride)
    seen = np.empty((batch, down, across, size * size, depth), value.dtype)
    for y, x in _places(layer):
        part = padded[:, y * layer.dilation :, x * layer.dilation :]
        part = part[:, : down * layer.stride : layer.stride, : across * layer.stride : layer.stride]
        seen[:, :, :, y * size + x] = part
    return seen.reshape(batch, down, across, -1)


def _places(layer: Layer) -> Iterator[tuple[int, int]]:
    """Yield row and column of each place of a layer's kernel."""
    return itertools.product(range(layer.size), range(layer.size))


def _spread(columns: F32, layer: Layer, shape: tuple[int, ...]) -> F32:
    """Return the gradient of a layer's input from that of its patches."""
    if layer.size == 1:
        return columns
    batch, rows, across = columns.shape[:3]
    pad = layer.pad
    padded = np.zeros((batch, shape[1] + 2 * pad, shape[2] + 2 * pad, shape[3]), columns.dtype)
    parts = columns.reshape(batch, rows, across, layer.size, layer.size, shape[3])
    for y, x in _places(layer):
        top, left = y * layer.dilation, x * layer.dilation
        bottom, right = top + rows * layer.stride, left + across * layer.stride
        place = padded[:, top : bottom : layer.stride, left : right : layer.stride]
        place += parts[:, :, :, y, x]
    return padded[:, pad : pad + shape[1], pad : pad + shape[2]]


def targets(boxes: list[F32], rows: int, columns: int) -> tuple[F32, F32, F32]:
    """Return wanted boxes (n, rows, columns, 4), wanted scores (.., CLASSES) and box weights.

    boxes: per image (k, 5) class, centre and size in pixels. The cell of the centre and those
    beside it whose middles are nearer than a cell are to find the box; the score falls off with it.
    """
    wanted = np.zeros((len(boxes), rows, columns, 4), np.float32)
    scores = np.zeros((len(boxes), rows, columns, CLASSES), np.float32)
    weights = np.zeros((len(boxes), rows, columns), np.float32)
    y_px, x_px = ((np.arange(count) + 0.5) * STRIDE_PX for count in (rows, columns))
    for index, found in enumerate(boxes):
        for kind, x, y, width, height in found:
            away = np.hypot((y_px - y)[:, None], (x_px - x)[None, :]) / STRIDE_PX
            peak = np.exp(-((away / 0.9) ** 2)).astype(np.float32)
            peak[np.unravel_index(np.argmax(peak), peak.shape)] = 1.0
            near = peak > 0.25
            better = near & (peak > weights[index])
            wanted[index, better, 0] = np.broadcast_to((x - x_px) / STRIDE_PX, away.shape)[better]
            wanted[index, better, 1] = np.broadcast_to(
                ((y - y_px) / STRIDE_PX)[:, None], away.shape
            )[better]
            wanted[index, better, 2] = np.log(width / BOX_PX)
            wanted[index, better, 3] = np.log(height / BOX_PX)
            weights[index, better] = peak[better]
            of_kind = scores[index, :, :, int(kind)]
            np.maximum(of_kind, np.where(near, peak, 0.0), out=of_kind)
    return wanted, scores, weights


def loss(output: F32, wanted: F32, scores: F32, weights: F32, whole: float) -> tuple[float, F32]:
    """Return the loss, and its gradient by the output; whole: sum of a whole batch's weights.

    Scores: cross-entropy weighted by the square of the error (quality focal loss, Li and others,
    NeurIPS 2020). Boxes: absolute error beyond 0.05, squared below (Huber), of the cells near one.
    """
    gradient = np.zeros_like(output)
    chance = 1.0 / (1.0 + np.exp(-output[..., 4:]))
    off = chance - scores
    entropy = -(scores * np.log(chance + 1e-7) + (1 - scores) * np.log(1 - chance + 1e-7))
    count = max(1.0, whole)
    slope = off * off * off + 2.0 * off * chance * (1 - chance) * entropy
    gradient[..., 4:] = slope / count
    miss = output[..., :4] - wanted
    width = 0.05
    huber = np.where(np.abs(miss) < width, miss * miss / (2 * width), np.abs(miss) - width / 2)
    share = (weights / count)[..., None]
    gradient[..., :4] = 1.0 * share * np.clip(miss / width, -1, 1)
    return float((off * off * entropy).sum() / count + (huber * share).sum()), gradient
