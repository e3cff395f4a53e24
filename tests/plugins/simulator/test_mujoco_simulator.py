"""The example of MuJoCo draws what our renderer draws: still, moving, near, and off the axis.

MuJoCo is no dependency of this program: `pip install mujoco`, with EGL or OSMesa, runs this.
"""

import math
import os
from typing import Any

import numpy as np
import pytest

os.environ.setdefault("MUJOCO_GL", "egl")
pytest.importorskip("mujoco", reason="MuJoCo is no dependency: pip install mujoco, with EGL")

from wil_campaign.plugins.readings.messagepack import MessageHeader
from wil_campaign.plugins.simulator.mujoco_simulator import MujocoSimulator
from wil_campaign.plugins.simulator.shown_world import asked_world, world_disagreements
from wil_campaign.plugins.simulator.simulator_protocol import (
    ImageRequest,
    SimulatorRefusedError,
    ask_parts,
    hello_parts,
    simulated_image_of,
    welcome_of,
)
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.render.renderer import Renderer
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import box_shape, gate_shape

BLOCK_AND_GATE = Scene(
    (
        SceneObject(1, "block", box_shape((0.4, 0.6, 0.8)), Pose.of(4.0, -1.0, 0.4, yaw_rad=0.3)),
        SceneObject(
            2, "gate", gate_shape("square", 1.0, 0.1), Pose.of(3.0, 1.1, 1.2, yaw_rad=-0.2)
        ),
    )
)
CAMERAS = {
    "straight": Intrinsics.from_fov(320, 240, math.radians(69.0)),
    "off the axis": Intrinsics(320, 240, 250.0, 240.0, 150.3, 125.7, ()),
}
POSES = [
    Pose.of(0.0, 0.0, 1.2),
    Pose.of(2.0, 1.0, 1.25, yaw_rad=0.1, pitch_rad=-0.05, roll_rad=0.14),
    Pose.of(5.0, 1.0, 1.2, yaw_rad=math.pi, roll_rad=0.07),
]


@pytest.fixture(scope="module")
def simulator() -> MujocoSimulator:
    return MujocoSimulator()


def greet(simulator: MujocoSimulator, scene: Scene) -> tuple[str, ...]:
    asked = asked_world(scene, world="gate", case="large")
    welcome = welcome_of(simulator.reply([bytes(part) for part in hello_parts(asked)]))
    assert welcome.objects == tuple(thing.name for thing in scene.objects)
    return world_disagreements(asked, welcome.shown)


def asked(simulator: MujocoSimulator, ask: ImageRequest) -> Any:
    return simulated_image_of(simulator.reply([bytes(part) for part in ask_parts(ask)]), ask)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("pose", POSES)
def test_ids_and_depth_are_where_our_renderer_has_them(
    simulator: MujocoSimulator, camera: Intrinsics, pose: Pose
) -> None:
    assert greet(simulator, BLOCK_AND_GATE) == ()
    seen = asked(simulator, ImageRequest(1, 0.0, pose, camera, want_depth=True, want_ids=True))
    ours = Renderer(BLOCK_AND_GATE).render(pose, camera, 0.0, {}, want_depth=True, want_ids=True)
    assert ours.depth_m is not None
    assert 2 in seen.object_ids
    assert ours.depth_m is not None
    assert np.count_nonzero(seen.object_ids != ours.object_ids) <= 5
    both = (seen.object_ids == ours.object_ids) & (seen.object_ids != 0)
    assert np.abs(seen.depth_m[both] - ours.depth_m[both]).max() < 0.01
    assert np.isinf(seen.depth_m[seen.object_ids == 0]).all()


def test_a_moved_object_is_drawn_where_it_was_requested(simulator: MujocoSimulator) -> None:
    greet(simulator, BLOCK_AND_GATE)
    moved = Pose.of(3.0, 0.2, 1.0, yaw_rad=0.4)
    camera, pose = CAMERAS["straight"], POSES[0]
    seen = asked(
        simulator, ImageRequest(1, 0.0, pose, camera, want_ids=True, moved={"gate": moved})
    )
    gate_there = SceneObject(2, "gate", BLOCK_AND_GATE["gate"].shape, moved)
    scene = Scene((BLOCK_AND_GATE["block"], gate_there))
    ours = Renderer(scene).render(pose, camera, 0.0, {}, want_ids=True)
    assert np.count_nonzero(seen.object_ids != ours.object_ids) <= 5


def test_a_shape_that_it_cannot_draw_is_refused(simulator: MujocoSimulator) -> None:
    ring = Scene((SceneObject(2, "gate", gate_shape("ring", 1.0, 0.1), Pose.of(3.0, 0.0, 1.2)),))
    hello = hello_parts(asked_world(ring, world="gate", case="large"))
    reply = simulator.reply([bytes(part) for part in hello])
    assert MessageHeader.unpack(reply[0]).text("type") == "error"
    with pytest.raises(SimulatorRefusedError, match="draws no ring gate"):
        welcome_of(reply)
