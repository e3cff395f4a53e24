"""A simulator that shows another world than the one that is judged is found by what it says."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from wil_campaign.foundation.files.documents import load_document
from wil_campaign.plugins.readings.messagepack import BadMessageError, MessageHeader, pack_header
from wil_campaign.plugins.simulator.shown_world import (
    ShownWorld,
    asked_world,
    packed_objects,
    poses_of_moving,
    shown_objects,
    shown_world,
    world_disagreements,
)
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import gate_shape
from wil_campaign.worlds.world_file.world import World

ROOT = Path(__file__).parents[3]
GATE = SceneObject(2, "gate", gate_shape("square", 1.0, 0.1), Pose.of(3.0, 1.1, 1.2))
ASKED = asked_world(Scene((GATE,)), world="gate", case="large")


def answered(thing: SceneObject = GATE, **more: Any) -> ShownWorld:
    """Return what a simulator says that draws a thing, through the greeting's own bytes."""
    shapes = packed_objects(shown_objects(Scene((thing,))))
    return shown_world(MessageHeader.unpack(pack_header({"shapes": shapes, **more})))


def test_the_shipped_world_agrees_with_itself() -> None:
    scene = World.parse(load_document(ROOT / "worlds" / "gate.yaml")).scene("wil", "Wv")
    shapes = packed_objects(shown_objects(scene))
    shown = shown_world(MessageHeader.unpack(pack_header({"world": "gate", "shapes": shapes})))
    assert world_disagreements(asked_world(scene, world="gate", case="large"), shown) == ()


def test_the_greeting_has_the_form_and_the_colour_of_a_gate_and_no_colour_of_a_room() -> None:
    scene = World.parse(load_document(ROOT / "worlds" / "gate.yaml")).scene("wil", "Wv")
    shapes = packed_objects(asked_world(scene, world="gate", case="large").objects)
    assert (shapes["gate"]["form"], shapes["gate"]["color_rgb"]) == ("square", [255, 120, 0])
    assert not shapes["cage"].keys() & {"form", "color_rgb", "opening_m"}


def test_places_of_moving_objects_are_of_the_time_and_omit_standing_ones() -> None:
    scene = World.parse(load_document(ROOT / "worlds" / "follow.yaml")).scene("wil", "Wv")
    moving = [thing for thing in scene.objects if thing.motion is not None]
    early, late = (poses_of_moving(scene, t_s, {"goal": 2.0}) for t_s in (2.0, 6.0))
    assert moving
    assert set(early) == {thing.name for thing in moving} != {thing.name for thing in scene.objects}
    assert all(late[one.name] == one.pose_at(6.0, {"goal": 2.0}) for one in moving)
    assert early != late


def test_omitted_facts_of_the_shown_world_agree() -> None:
    assert world_disagreements(ASKED, shown_world(MessageHeader.unpack(pack_header({})))) == ()


@pytest.mark.parametrize(
    ("shown", "said"),
    [
        (
            answered(replace(GATE, shape=gate_shape("square", 0.5, 0.1))),
            (
                "it shows gate with an opening of 0.50 m, and 1.00 m is judged",
                "it shows gate 0.10 x 0.70 x 0.70 m large, and 0.10 x 1.20 x 1.20 m is judged",
            ),
        ),
        (
            answered(replace(GATE, pose=Pose.of(3.0, 0.0, 1.2))),
            ("it shows gate 1.10 m from its place",),
        ),
        (
            answered(replace(GATE, pose=Pose.of(3.0, 1.1, 1.2, yaw_rad=0.5))),
            ("it shows gate turned by 29 degrees",),
        ),
        (
            answered(replace(GATE, shape=gate_shape("ring", 1.0, 0.1))),
            ("it shows gate as a ring, and a square is judged",),
        ),
        (
            answered(replace(GATE, name="gaet")),
            ("it does not show gate: the `shapes` of its `welcome` lack this object",),
        ),
        (answered(world="hall"), ("it shows the world 'hall', and 'gate' is flown",)),
        (answered(case="small"), ("it shows the case 'small', and 'large' is flown",)),
    ],
)
def test_another_world_is_a_disagreement(shown: ShownWorld, said: tuple[str, ...]) -> None:
    assert world_disagreements(ASKED, shown) == said


def test_single_precision_and_a_millimetre_are_no_disagreement() -> None:
    near = replace(GATE, shape=gate_shape("square", 1.004, 0.1), pose=Pose.of(3.004, 1.1, 1.2))
    assert world_disagreements(ASKED, answered(near)) == ()


@pytest.mark.parametrize(
    "wrong", [{"size_m": [1.0]}, {"position_ned_m": "here"}, {"q_wxyz": [1.0, 0.0, 0.0]}]
)
def test_shapes_that_cannot_be_read_are_refused(wrong: dict[str, Any]) -> None:
    shapes = packed_objects(shown_objects(Scene((GATE,))))
    shapes["gate"] |= wrong
    with pytest.raises(BadMessageError, match="shape 'gate'"):
        shown_world(MessageHeader.unpack(pack_header({"shapes": shapes})))
