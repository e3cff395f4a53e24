"""The shipped detector finds persons and drones in the worlds of the campaigns, and no others."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from wil_campaign.foundation.files.documents import load_document
from wil_campaign.plugins.detector.shipped_detector import NAMES, shipped_detector
from wil_campaign.vehicles.readings import BgrImage
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.render.renderer import Renderer
from wil_campaign.worlds.world_file.world import World

WORLDS = Path(__file__).parents[3] / "worlds"
CAMERA = Intrinsics.from_fov(640, 480, math.radians(69.0))
EYE = Pose.of(0.1, 0.0, 1.0)
Box = tuple[float, float, float, float]


def frames(name: str, thing: str, times: np.ndarray) -> Iterator[tuple[BgrImage, Box | None]]:
    """Yield images of a world as the vehicle's camera has them, and where the thing is in them."""
    scene = World.parse(load_document(WORLDS / f"{name}.yaml")).scene("sim", "Wv")
    renderer = Renderer(scene)
    for t_s in times:
        made = renderer.render(EYE, CAMERA, float(t_s), {"goal": 0.0}, want_depth=False)
        assert made.object_ids is not None
        rows, columns = np.nonzero(made.object_ids == scene[thing].object_id)
        box = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1) if rows.size else None
        yield made.image_bgr, box


def overlap(a: Box, b: Box) -> float:
    across = min(a[2], b[2]) - max(a[0], b[0])
    down = min(a[3], b[3]) - max(a[1], b[1])
    common = max(0.0, across) * max(0.0, down)
    sizes = [(one[2] - one[0]) * (one[3] - one[1]) for one in (a, b)]
    return common / (sum(sizes) - common)


@pytest.mark.parametrize(
    ("world", "thing", "name", "times"),
    [
        ("follow", "person", "person", np.arange(0.0, 10.0, 0.37)),
        ("avoid", "intruder", "quadrotor", np.arange(4.2, 7.0, 0.11)),
    ],
)
def test_the_shipped_detector_finds_the_things_of_shipped_campaigns(
    world: str, thing: str, name: str, times: np.ndarray
) -> None:
    detector = shipped_detector(threshold=0.5)
    found = wrong = shown = 0
    for image, box in frames(world, thing, times):
        assert box is not None
        shown += 1
        boxes = [
            (one.left_px, one.top_px, one.right_px, one.bottom_px)
            for one in detector.detect(image)
            if one.name == name
        ]
        right = [one for one in boxes if overlap(one, box) >= 0.5]
        found += bool(right)
        wrong += len(boxes) - len(right[:1])
    assert found >= 0.9 * shown
    assert wrong <= 0.05 * shown


def test_an_empty_cage_has_nobody_in_it() -> None:
    scene = World.parse(load_document(WORLDS / "gate.yaml")).scene("real", "Wv")
    renderer = Renderer(scene)
    detector = shipped_detector()
    for yaw_deg in range(0, 360, 30):
        pose = Pose.of(1.5, 0.0, 1.2, yaw_rad=math.radians(yaw_deg))
        image = renderer.render(pose, CAMERA, 0.0, want_depth=False, want_ids=False).image_bgr
        assert detector.detect(image) == ()


def test_a_threshold_drops_less_sure_boxes() -> None:
    ((image, _),) = frames("follow", "person", np.array([0.0]))
    (sure, *_) = shipped_detector(threshold=0.1).detect(image)
    assert sure.name in NAMES
    assert shipped_detector(threshold=min(1.0, sure.score + 0.01)).detect(image) == ()
