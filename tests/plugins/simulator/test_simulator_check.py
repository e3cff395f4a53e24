"""A simulator whose pictures are of another world than the one that is judged is found by its ids.

Stand-ins draw with our renderer what they are told to, and say nothing of what they show.
"""

import asyncio
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgpack  # type: ignore[import-untyped]  # ships no types
import numpy as np
import pytest

from tests.plugins.simulator.replier import Replier
from wil_campaign.plugins.simulator.simulator_camera import SimulatorError, ZmqImageSource
from wil_campaign.plugins.simulator.simulator_check import SimulatorCheck
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.render.renderer import Renderer
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import box_shape, gate_shape, person_shape

CAMERA = Intrinsics.from_fov(320, 240, math.radians(69.0))
GATE = SceneObject(2, "gate", gate_shape("square", 1.0, 0.1), Pose.of(3.0, 0.5, 1.2))
ASKED = Scene((GATE,))
PERIOD_S = 1 / 15

Drawn = Callable[[dict[str, Any]], Scene]


class StandIn(Replier):
    """A simulator on a thread: draws what `drawn` says of each question."""

    def __init__(
        self, drawn: Drawn, *, marks: tuple[str, ...] = ("gate",), frozen: bool = False
    ) -> None:
        self._drawn = drawn
        self._marks = marks
        self._frozen = frozen
        self._first: dict[str, Any] = {}
        super().__init__(self._answer)
        self.wanted: list[list[str]] = []

    def _answer(self, ask: dict[str, Any]) -> list[bytes]:
        if ask["type"] == "hello":
            said = {"type": "welcome", "simulator": "stand-in", "objects": list(self._marks)}
            return [msgpack.packb({"protocol": ask["protocol"], **said})]
        self.wanted.append(ask["want"])
        self._first = self._first or ask
        seen = self._first if self._frozen else ask
        pose = Pose(tuple(seen["position_ned_m"]), tuple(seen["q_wxyz"]))
        camera = Intrinsics(**{**ask["camera"], "distortion": ()})
        drawn = Renderer(self._drawn(seen)).render(pose, camera, seen["t_s"], {}, want_ids=True)
        keys = ("protocol", "seq", "t_s", "position_ned_m", "q_wxyz")
        header = {key: ask[key] for key in keys} | {"type": "picture"}
        header["parts"] = [{"name": "image", "encoding": "bgr8"}]
        parts = [drawn.image_bgr.tobytes()]
        if "ids" in ask["want"]:
            header["parts"].append({"name": "ids", "encoding": "u8"})
            parts.append(np.asarray(drawn.object_ids, np.uint8).tobytes())
        return [msgpack.packb(header), *parts]


async def flown(
    stand_in: StandIn, *, asked: Scene = ASKED, speed_m_s: float = 0.5
) -> SimulatorCheck:
    """Fly three seconds towards what stands there, without waiting, and look back."""
    async with ZmqImageSource(address=stand_in.address, timeout_s=20.0) as simulator:
        check = SimulatorCheck(simulator=simulator, scene=asked, events={})
        check.begin(lambda: True)
        for k in range(45):
            t_s = 10.0 + k * PERIOD_S
            pose = Pose.of(speed_m_s * k * PERIOD_S, 0.0, 1.2, yaw_rad=0.05 * math.sin(k))
            await asyncio.to_thread(check.picture, pose, CAMERA, t_s)
    return check


def always(*objects: SceneObject) -> Drawn:
    return lambda _: Scene(objects)


async def test_the_judged_world_is_no_fault_and_costs_two_pictures_of_ids_a_second() -> None:
    with StandIn(always(GATE)) as stand_in:
        check = await flown(stand_in)
    assert (check.fault, check.look_back(), check.not_measured) == ("", "", "")
    assert check.coverage.objects["gate"].shown == check.coverage.frames == 6
    assert sum("ids" in want for want in stand_in.wanted) == 6


@pytest.mark.parametrize(
    "wrong",
    [
        replace(GATE, shape=gate_shape("square", 0.5, 0.1)),
        replace(GATE, shape=gate_shape("square", 1.2, 0.1)),
        replace(GATE, pose=Pose.of(3.0, 0.7, 1.2)),
        replace(GATE, pose=Pose.of(3.3, 0.5, 1.2)),
    ],
    ids=["smaller", "larger", "aside", "behind"],
)
async def test_a_gate_of_another_size_or_elsewhere_is_a_fault_that_names_it(
    wrong: SceneObject,
) -> None:
    with StandIn(always(wrong)) as stand_in:
        check = await flown(stand_in)
    said = f"the simulator at {stand_in.address} shows gate "
    assert check.fault.startswith(said), check.fault
    assert "px from its place at 10." in check.fault
    assert check.look_back() == check.fault


async def test_nothing_at_all_is_a_fault() -> None:
    with StandIn(always()) as stand_in:
        check = await flown(stand_in)
    said = f"the simulator at {stand_in.address} never showed gate: it was in view in "
    assert check.fault.startswith(said), check.fault


async def test_a_picture_that_is_frozen_is_a_fault() -> None:
    with StandIn(always(GATE), frozen=True) as stand_in:
        check = await flown(stand_in)
    assert "px from its place" in check.fault


async def test_a_gate_where_none_can_be_in_view_is_a_fault() -> None:
    behind = Scene((replace(GATE, pose=Pose.of(-6.0, 0.0, 1.2)),))
    with StandIn(always(GATE)) as stand_in:
        check = await flown(stand_in, asked=behind)
    assert "shows something virtual in " in check.fault
    assert check.fault.endswith("where geometry expects nothing")


async def test_a_person_may_be_another_model_and_stands_in_its_place() -> None:
    someone = SceneObject(2, "gate", person_shape(), Pose.of(4.0, 0.3, 0.0))
    like = replace(someone, shape=box_shape((0.3, 0.5, 1.75)), pose=Pose.of(4.0, 0.3, 0.875))
    away = replace(like, pose=Pose.of(4.0, -0.7, 0.875))
    with StandIn(always(like)) as stand_in:
        check = await flown(stand_in, asked=Scene((someone,)))
    assert check.fault == ""
    with StandIn(always(away)) as stand_in:
        check = await flown(stand_in, asked=Scene((someone,)))
    assert check.fault


async def test_a_simulator_that_marks_nothing_is_trusted_and_named() -> None:
    with StandIn(always(), marks=()) as stand_in:
        check = await flown(stand_in)
    assert (check.fault, check.look_back()) == ("", "")
    assert check.not_measured == "it marks no gate (`objects` of its `welcome`)"
    assert not any("ids" in want for want in stand_in.wanted)


async def test_nothing_is_measured_before_the_goal() -> None:
    with StandIn(always()) as stand_in:
        async with ZmqImageSource(address=stand_in.address, timeout_s=20.0) as simulator:
            check = SimulatorCheck(simulator=simulator, scene=ASKED, events={})
            for k in range(30):
                await asyncio.to_thread(check.picture, Pose.of(0.0, 0.0, 1.2), CAMERA, float(k))
    assert (check.coverage.frames, check.look_back()) == (0, "")


async def test_a_simulator_without_the_ids_it_promises_is_found_before_anything_starts() -> None:
    class Empty(StandIn):
        def _answer(self, ask: dict[str, Any]) -> list[bytes]:
            return super()._answer(ask | {"want": ["image"]})

    with Empty(always(GATE)) as stand_in:
        async with ZmqImageSource(address=stand_in.address, timeout_s=20.0) as simulator:
            with pytest.raises(SimulatorError, match=r"it has .*; requested were \['image', "):
                await simulator.warm_up(Pose.of(0.0, 0.0, 1.2), CAMERA, 0.0)
