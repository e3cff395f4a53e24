"""Trains the shipped detector of persons and drones, and measures it on images it has not seen.

    python -m bench.train_detector [--out FILE] [--scenes N] [--epochs N] [--measure FILE]

Draws labelled images with our renderer (bench/detector/images.py), trains a small convolutional
network with NumPy alone, writes an ONNX file, and prints precision and recall of that file on
rooms, colours and ways of moving of another seed, found as a recipe or an autonomy would find them.
A minute of one core for each pass (OPENBLAS_NUM_THREADS=1), two for drawing; with --measure FILE
only the last part. docs/detector.md says how the shipped file was trained.
"""

import argparse
import math
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from bench.detector.images import HEIGHT_PX, NAMES, WIDTH_PX, LabelledImage, labelled_images
from bench.detector.network import F32, STRIDE_PX, Network, loss, targets
from bench.detector.onnx_file import onnx_bytes, read_weights
from wil_campaign.plugins.detector.detector import Detection, OnnxDetector

OUT = Path(__file__).parents[1] / "plugins" / "detector" / "models" / "person-quadrotor.onnx"
TRAIN_SEED, HELD_SEED = 1, 1000
EACH = 45
HELD_SCENES, HELD_EACH = 15, 32
BATCH = 16
THREADS = 2
RATE = 2e-3
THRESHOLD = 0.5
SAME = 0.5
"""Intersection over union from which on a detection has found an object."""


@dataclass(frozen=True, slots=True)
class Score:
    """What was found of one class. area_error: median of the found boxes, as a share."""

    name: str
    right: int
    wrong: int
    missed: int
    area_error: float

    def __str__(self) -> str:
        precision = self.right / max(1, self.right + self.wrong)
        recall = self.right / max(1, self.right + self.missed)
        return (
            f"{self.name}: precision {precision:.3f}, recall {recall:.3f} of "
            f"{self.right + self.missed} (median error of the box's area {self.area_error:.1%})"
        )


def train(
    network: Network, shown: Sequence[LabelledImage], epochs: int, seed: int, threads: int
) -> None:
    """Train a network on images, mirrored in half of the cases; the rate falls as a cosine."""
    rng = np.random.default_rng(seed)
    images = np.stack([image.image_bgr for image in shown])
    pool = ThreadPoolExecutor(threads)
    steps, done, began_s = epochs * (len(shown) // BATCH), 0, time.monotonic()
    for epoch in range(epochs):
        order, sums = rng.permutation(len(shown)), 0.0
        for first in range(0, len(shown) - BATCH + 1, BATCH):
            chosen = order[first : first + BATCH]
            batch = images[chosen].astype(np.float32) / 255.0
            boxes = [shown[index].boxes for index in chosen]
            for place in np.flatnonzero(rng.random(BATCH) < 0.5):
                batch[place] = batch[place, :, ::-1]
                boxes[place] = mirrored(boxes[place])
            wanted = targets(boxes, HEIGHT_PX // STRIDE_PX, WIDTH_PX // STRIDE_PX)
            parts = [slice(part, BATCH, threads) for part in range(threads)]
            made = list(pool.map(partial(gradients, network, batch, wanted), parts))
            value = sum(one for one, _ in made)
            rate = RATE * 0.5 * (1.0 + math.cos(math.pi * done / steps)) * min(1.0, done / 100)
            network.step([sum(each) for each in zip(*(g for _, g in made), strict=True)], rate)
            sums, done = sums + value, done + 1
        spent_s = time.monotonic() - began_s
        print(
            f"epoch {epoch + 1}: loss {sums / (len(shown) // BATCH):.4f}, {spent_s:.0f} s",
            flush=True,
        )


def gradients(
    network: Network, batch: F32, wanted: tuple[F32, F32, F32], part: slice
) -> tuple[float, list[F32]]:
    """Return the loss and the gradients of a part of a batch, as shares of the whole."""
    output, kept = network.forward(batch[part])
    boxes, scores, weights = (one[part] for one in wanted)
    value, gradient = loss(output, boxes, scores, weights, float(wanted[2].sum()))
    return value, network.backward(kept, gradient)


def mirrored(boxes: F32) -> F32:
    """Return the boxes of an image whose left and right are changed."""
    turned = boxes.copy()
    turned[:, 1] = WIDTH_PX - turned[:, 1]
    return turned


def measure(model: Path, shown: Sequence[LabelledImage]) -> list[Score]:
    """Return what a detector finds in images, class by class."""
    detector = OnnxDetector(model, names=NAMES, input_px=(WIDTH_PX, HEIGHT_PX), threshold=THRESHOLD)
    scores = []
    found = [detector.detect(image.image_bgr) for image in shown]
    for kind, name in enumerate(NAMES):
        right = wrong = missed = 0
        areas: list[float] = []
        for image, detections in zip(shown, found, strict=True):
            open_boxes = [box for box in image.boxes if int(box[0]) == kind]
            for detection in (one for one in detections if one.name == name):
                best = max(open_boxes, key=lambda box: overlap(detection, box), default=None)
                if best is None or overlap(detection, best) < SAME:
                    wrong += 1
                    continue
                right += 1
                open_boxes = [box for box in open_boxes if box is not best]
                areas.append(abs(_area_px2(detection) / float(best[3] * best[4]) - 1.0))
            missed += len(open_boxes)
        scores.append(Score(name, right, wrong, missed, float(np.median(areas or [math.nan]))))
    return scores


def _area_px2(found: Detection) -> float:
    return (found.right_px - found.left_px) * (found.bottom_px - found.top_px)


def overlap(found: Detection, box: F32) -> float:
    """Return the intersection over the union of a detection and a labelled box."""
    x, y, width, height = (float(value) for value in box[1:])
    across = min(found.right_px, x + width / 2) - max(found.left_px, x - width / 2)
    down = min(found.bottom_px, y + height / 2) - max(found.top_px, y - height / 2)
    common = max(0.0, across) * max(0.0, down)
    return common / (_area_px2(found) + width * height - common)


def main() -> None:
    """Train and measure, or measure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--scenes", type=int, default=90)
    parser.add_argument("--epochs", type=int, default=9)
    parser.add_argument("--seed", type=int, default=TRAIN_SEED, help="of the training images")
    parser.add_argument(
        "--held-seed", type=int, default=HELD_SEED, help="of the images to measure by"
    )
    parser.add_argument("--threads", type=int, default=THREADS)
    parser.add_argument("--start-from", type=Path, help="a file of this script to train further")
    parser.add_argument("--measure", type=Path)
    asked = parser.parse_args()
    if asked.seed == asked.held_seed:
        parser.error("--seed and --held-seed draw the same images")
    model = asked.measure
    if model is None:
        shown = list(labelled_images(asked.seed, asked.scenes, EACH))
        network = Network(np.random.default_rng(0))
        if asked.start_from is not None:
            read_weights(network, asked.start_from.read_bytes())
        train(network, shown, asked.epochs, seed=0, threads=asked.threads)
        model = asked.out
        model.parent.mkdir(parents=True, exist_ok=True)
        model.write_bytes(onnx_bytes(network, WIDTH_PX, HEIGHT_PX))
    print(f"{model.name}: {model.stat().st_size / 1e3:.0f} kB, threshold {THRESHOLD}, IoU {SAME}")
    for score in measure(model, list(labelled_images(asked.held_seed, HELD_SCENES, HELD_EACH))):
        print(score)


if __name__ == "__main__":
    main()
