"""A simulator in another process is asked; and simulators that answer wrong, late or not at all."""

import asyncio
import math
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack  # type: ignore[import-untyped]  # ships no types
import numpy as np
import pytest

from tests.plugins.simulator.replier import Replier, Reply
from wil_campaign.foundation.files.documents import load_document
from wil_campaign.plugins.simulator.shown_world import asked_world
from wil_campaign.plugins.simulator.simulator_camera import (
    SimulatorError,
    SimulatorTimeoutError,
    ZmqImageSource,
)
from wil_campaign.vehicles.cameras.rendered_cameras import ImageSource, OnDemandCamera
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.render.renderer import Renderer
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import gate_shape
from wil_campaign.worlds.world_file.world import World

ROOT = Path(__file__).parents[3]
WORLD = ROOT / "worlds" / "gate.yaml"
CAMERA = Intrinsics.from_fov(160, 120, math.radians(69.0))
AHEAD = Pose.of(0.0, 0.0, 1.2)
SMALL_GATE = SceneObject(2, "gate", gate_shape("square", 0.5, 0.1), Pose.of(3.0, 1.1, 1.2))
WORLD_ASKED = asked_world(Scene((SMALL_GATE,)), world="gate", case="small")


@pytest.fixture
def reference() -> Iterator[tuple[str, "subprocess.Popen[str]"]]:
    command = [sys.executable, "-m", "wil_campaign.plugins.simulator.reference_simulator"]
    arguments = ["--world", str(WORLD), "--bind", "tcp://127.0.0.1:*"]
    process = subprocess.Popen(  # noqa: S603 - our own program
        [*command, *arguments], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    yield process.stdout.readline().strip(), process
    process.kill()
    process.wait()
    process.stdout.close()


class Simulator(Replier):
    """Answers as a test wants, and greets as a simulator does."""

    def __init__(self, answer: Reply, *, greets: bool = True) -> None:
        self._answer = answer
        self._greets = greets
        super().__init__(self._answer_or_greet)

    def _answer_or_greet(self, ask: dict[str, Any]) -> list[bytes]:
        return welcome() if ask["type"] == "hello" and self._greets else self._answer(ask)


def welcome() -> list[bytes]:
    header = {"protocol": "wil/pictures/1", "type": "welcome", "simulator": "fake"}
    return [msgpack.packb(header)]


def right(ask: dict[str, Any], **changed: Any) -> list[bytes]:
    size = ask["camera"]["height_px"], ask["camera"]["width_px"], 3
    keys = ("protocol", "seq", "t_s", "position_ned_m", "q_wxyz")
    header = {key: ask[key] for key in keys} | {"type": "picture"}
    header["parts"] = [{"name": "image", "encoding": "bgr8"}]
    image = np.full(size, ask["seq"], np.uint8)
    return [msgpack.packb(header | changed), image.tobytes()]


async def ask(source: ZmqImageSource) -> int:
    picture = await source.ask(AHEAD, CAMERA, 1.0, want_depth=False, want_ids=False)
    return int(picture.image_bgr[0, 0, 0])


async def test_the_reference_simulator_draws_what_our_renderer_draws(
    reference: tuple[str, "subprocess.Popen[str]"],
) -> None:
    renderer = Renderer(World.parse(load_document(WORLD)).scene("wil", "Wv"))
    pose = Pose.of(0.4, -0.2, 1.3, yaw_rad=0.1, pitch_rad=-0.05)
    async with ZmqImageSource(address=reference[0], timeout_s=20.0, open_timeout_s=20.0) as source:
        assert source.welcome.objects == ("cage", "gate")
        picture = await source.ask(pose, CAMERA, 2.0)
        camera = OnDemandCamera(
            source=as_source(source), intrinsics=CAMERA, compute=asyncio.to_thread
        )
        reading = await camera.ask(pose, 2.0, want_ids=True)
    expected = renderer.render(pose, CAMERA, 2.0)
    assert np.array_equal(picture.image_bgr, expected.image_bgr)
    assert picture.depth_m is not None
    assert picture.object_ids is not None
    assert picture.depth_m is not None
    assert expected.depth_m is not None
    assert expected.object_ids is not None
    assert np.array_equal(picture.depth_m, expected.depth_m)
    assert np.array_equal(picture.object_ids, expected.object_ids)
    assert 2 in picture.object_ids
    assert np.array_equal(reading.image_bgr, expected.image_bgr)
    assert reading.depth_m is None


def as_source(source: ZmqImageSource) -> ImageSource:
    return source


async def test_a_simulator_that_dies_is_a_clear_error_and_never_a_hang(
    reference: tuple[str, "subprocess.Popen[str]"],
) -> None:
    address, process = reference
    async with ZmqImageSource(address=address, timeout_s=20.0, open_timeout_s=20.0) as source:
        await source.ask(AHEAD, CAMERA, 0.0)
        source._timeout_s = 0.2
        process.kill()
        process.wait()
        for _ in range(2):
            with pytest.raises(SimulatorTimeoutError, match=r"did not answer|no simulator is"):
                await source.ask(AHEAD, CAMERA, 0.1)
        assert source.counts.timeouts == 2


def garbage() -> list[tuple[str, Reply, str]]:
    return [
        ("rubbish", lambda _: [b"rubbish"], "MessagePack"),
        ("empty", lambda _: [b""], "MessagePack"),
        ("version", lambda a: right(a, protocol="wil/pictures/9"), "speaks 'wil/pictures/9'"),
        ("next", lambda a: right(a, seq=a["seq"] + 1), "not sent yet"),
        ("pose", lambda a: right(a, position_ned_m=[9.0, 0.0, 0.0]), "another pose"),
        ("time", lambda a: right(a, t_s=a["t_s"] + 1.0), "another time"),
        ("short", lambda a: [right(a)[0], right(a)[1][:-1]], "bytes"),
        ("bare", lambda a: right(a)[:1], "lists 1 parts, 0 arrived"),
        ("image", lambda a: [right(a)[0], b""], "0 bytes"),
    ]


@pytest.mark.parametrize(
    ("answer", "words"), [g[1:] for g in garbage()], ids=[g[0] for g in garbage()]
)
async def test_garbage_is_counted_reported_and_never_an_image(answer: Reply, words: str) -> None:
    good = [False]
    with Simulator(lambda a: right(a) if good[0] else answer(a)) as simulator:
        async with ZmqImageSource(address=simulator.address, timeout_s=20.0) as source:
            with pytest.raises(SimulatorError, match=f"reply is wrong.*{words}"):
                await ask(source)
            assert source.counts.garbage == 1
            good[0] = True
            assert await ask(source) == 2
            assert (source.counts.asked, source.counts.answered) == (2, 1)


async def test_a_refusal_is_passed_on() -> None:
    refusal = {"protocol": "wil/pictures/1", "type": "error", "seq": 1, "message": "no such map"}
    with Simulator(lambda _: [msgpack.packb(refusal)]) as simulator:
        async with ZmqImageSource(address=simulator.address, timeout_s=20.0) as source:
            with pytest.raises(SimulatorError, match="the simulator refused: no such map"):
                await ask(source)
            assert source.counts.refused == 1


async def test_a_late_answer_is_never_taken_for_the_present_one() -> None:
    late = threading.Event()

    def slow_once(question: dict[str, Any]) -> list[bytes]:
        if question["seq"] == 1:
            late.wait(5.0)
        return right(question)

    with Simulator(slow_once) as simulator:
        async with ZmqImageSource(address=simulator.address, timeout_s=0.15) as source:
            with pytest.raises(SimulatorTimeoutError, match=r"0\.15 s"):
                await ask(source)
            source._timeout_s = 20.0
            late.set()
            assert await ask(source) == 2
            assert source.counts.late == 1


async def test_questions_from_several_threads_get_their_own_answers() -> None:
    with Simulator(right) as simulator:
        async with ZmqImageSource(address=simulator.address, timeout_s=20.0) as source:
            found = await asyncio.gather(*(ask(source) for _ in range(20)))
    assert sorted(found) == list(range(1, 21))


async def test_a_question_after_closing_is_an_error() -> None:
    with Simulator(right) as simulator:
        async with ZmqImageSource(address=simulator.address, timeout_s=20.0) as source:
            await ask(source)
        with pytest.raises(SimulatorError, match="connection is closed"):
            await ask(source)


async def test_a_missing_simulator_is_reported_at_the_start() -> None:
    with pytest.raises(SimulatorTimeoutError, match="no simulator is connected; start it"):
        async with ZmqImageSource(address="tcp://127.0.0.1:9", open_timeout_s=0.2):
            pass
    with pytest.raises(SimulatorError, match="not a valid address"):
        async with ZmqImageSource(address="gate.yaml"):
            pass


async def test_a_peer_that_greets_wrong_is_refused() -> None:
    with (
        Simulator(
            lambda _: [msgpack.packb({"protocol": "x", "type": "welcome"})], greets=False
        ) as s,
        pytest.raises(SimulatorError, match="speaks 'x'"),
    ):
        async with ZmqImageSource(address=s.address):
            pass


async def test_a_simulator_that_refuses_the_world_is_quoted() -> None:
    def refuse(question: dict[str, Any]) -> list[bytes]:
        said = {"seq": 0, "message": "no world 'gate' here, only 'hall'"}
        return [msgpack.packb({"protocol": question["protocol"], "type": "error", **said})]

    with (
        Simulator(refuse, greets=False) as s,
        pytest.raises(SimulatorError, match="the simulator refused: no world 'gate' here"),
    ):
        async with ZmqImageSource(address=s.address):
            pass


async def test_events_and_objects_are_sent() -> None:
    asked: list[dict[str, Any]] = []

    def note(question: dict[str, Any]) -> list[bytes]:
        asked.append(question)
        return welcome() if question["type"] == "hello" else right(question)

    with Simulator(note, greets=False) as simulator:
        async with ZmqImageSource(
            address=simulator.address, world=WORLD_ASKED, events=lambda: {"t0": 3.5}
        ) as source:
            await ask(source)
    assert asked[0]["objects"] == {"gate": 2}
    assert (asked[0]["world"], asked[0]["case"]) == ("gate", "small")
    assert asked[0]["shapes"]["gate"]["opening_m"] == 0.5
    assert asked[1]["events"] == {"t0": 3.5}


async def test_the_reference_simulator_says_that_it_shows_another_case(
    reference: tuple[str, Any],
) -> None:
    address, _ = reference
    async with ZmqImageSource(address=address, world=WORLD_ASKED, open_timeout_s=20.0) as source:
        said = source.disagreements
    assert said[0] == "it shows gate with an opening of 1.00 m, and 0.50 m is judged"


async def test_a_first_image_that_takes_long_is_waited_for_and_not_counted() -> None:
    asked: list[int] = []

    def slow_at_first(question: dict[str, Any]) -> list[bytes]:
        asked.append(question["seq"])
        if len(asked) == 1:
            time.sleep(0.5)
        return right(question)

    with Simulator(slow_at_first) as simulator:
        async with ZmqImageSource(address=simulator.address, timeout_s=0.2) as source:
            await source.warm_up(AHEAD, CAMERA, 0.0)
            assert source.counts.asked == 0
            source._timeout_s = 20.0
            await ask(source)
    assert source.counts.answered == 1
    assert source.counts.timeouts == 0


async def test_a_time_out_names_the_limit_that_was_waited_for() -> None:
    def silent(question: dict[str, Any]) -> list[bytes]:
        time.sleep(1.5 if question["type"] == "ask" else 0.0)
        return right(question)

    with Simulator(silent) as simulator:
        async with ZmqImageSource(
            address=simulator.address, timeout_s=9.0, open_timeout_s=20.0
        ) as source:
            source._open_timeout_s = 0.3
            with pytest.raises(SimulatorError, match=r"did not answer in 0\.3 s"):
                await source.warm_up(AHEAD, CAMERA, 0.0)
