"""A finished run as the console plays it, and the command that does."""

import asyncio
import json
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.orchestrator.mcap_runs import recorder
from tests.orchestrator.report.recorded_campaign import END_S, GOAL_S, write_campaign
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.mcap.mcap_settings import EXACT, RecordingSettings
from wil_campaign.orchestrator.run_results.control_results import ControlResult
from wil_campaign.orchestrator.run_results.result_reader import read_result
from wil_campaign.plugins.console.console_access import AccessError
from wil_campaign.plugins.console.feed.feed_messages import (
    EventView,
    FactsView,
    FeedMessage,
    ImageView,
    RunView,
)
from wil_campaign.plugins.console.playback import Playback
from wil_campaign.plugins.console.recorded_run import RecordedRun
from wil_campaign.plugins.console.scene_document import RunScene
from wil_campaign.vehicles.readings import CameraReading, Drawing
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose


async def played(folder: Path) -> list[FeedMessage]:
    """Return what a run's recording shows until its verdict, the last view, or once more."""
    found: list[FeedMessage] = []
    is_over = asyncio.Event()

    async def take(message: FeedMessage) -> None:
        if not is_over.is_set():
            found.append(message)
        begins_again = isinstance(message, FactsView) and len(found) > 1
        if begins_again or (isinstance(message, RunView) and message.verdict_so_far):
            is_over.set()

    playback = Playback(100.0, time=asyncio.get_running_loop().time)
    playing = asyncio.create_task(RecordedRun(folder, playback).play(take))
    over = asyncio.create_task(is_over.wait())
    await asyncio.wait({playing, over}, return_when=asyncio.FIRST_COMPLETED)
    over.cancel()
    if not playing.done():
        playing.cancel()
        await asyncio.wait({playing})
        return found
    await playing
    raise AssertionError("it is played until it is cancelled")


async def test_the_verdict_of_a_control_says_how_it_had_to_end(tmp_path: Path) -> None:
    """Its PASS looked like that of a run."""
    folder = write_campaign(tmp_path / "gate") / "large" / "sim" / "1"
    result = read_result(folder / "result.json")
    assert result.verdict == "PASS"
    control = ControlResult("large", "FAIL", "reached", None, False)
    (folder / "result.json").write_text(to_json(replace(result, control=control)))
    views = [message for message in await played(folder) if isinstance(message, RunView)]
    assert views[-1].reason == "a control, NOT met: it must FAIL by reached"


async def test_a_finished_run_is_played_as_it_was_flown(tmp_path: Path) -> None:
    folder = write_campaign(tmp_path / "gate") / "large" / "wil" / "1"
    found = await played(folder)
    views = [one for one in found if isinstance(one, RunView)]
    times_s = [view.t_s for view in views]
    assert times_s == sorted(times_s)
    assert times_s[-1] == pytest.approx(END_S, abs=0.2)
    assert {vehicle.name for vehicle in views[-1].vehicles} >= {"real"}
    assert ([view.verdict_so_far for view in views[-2:]], views[-1].margins != ()) == (
        ["", "FAIL"],
        True,
    )
    assert all(("goal" in view.entered_s) == (view.t_s >= GOAL_S) for view in views)
    assert {one.name for one in found if isinstance(one, ImageView)} >= {"real", "mixed"}
    assert [one.number for one in found if isinstance(one, EventView)][:2] == [1, 2]
    assert set(views[0].fences) >= {"real"}
    facts = next(one.facts for one in found if isinstance(one, FactsView))
    (gate,) = RunScene.of("/r", facts).document["objects"]
    assert (gate["name"], gate["is_virtual"], gate["moves"]) == ("gate", True, False)
    assert max(max(face) for face in gate["faces"]) < len(gate["vertices_m"])


async def test_an_image_that_cannot_be_drawn_again_is_named_also_where_others_can(
    tmp_path: Path,
) -> None:
    """A mesh that was changed since may come into view late."""
    folder = write_campaign(tmp_path / "gate") / "large" / "wil" / "1"
    grey, camera = np.zeros((8, 8, 3), np.uint8), Intrinsics.from_fov(8, 8, 1.0)
    at = partial(CameraReading, source="real", image_bgr=grey, intrinsics=camera)
    settings = RecordingSettings(real=replace(EXACT, keeps_drawn=False))
    (folder / "run.mcap").unlink()
    with recorder(folder / "run.mcap", settings=settings, facts={}) as run:
        run.reading("camera", at(t_s=GOAL_S, arrived_s=GOAL_S, seq=0))
        late_s = GOAL_S + 1.0
        drawing = Drawing(Pose((0.0, 0.0, 0.0)))
        run.reading("camera", at(t_s=late_s, arrived_s=late_s, seq=1, drawing=drawing))
    found = await played(folder)
    named = [one.text for one in found if isinstance(one, EventView) and one.kind == "recording"]
    assert [text.partition(" is not ")[0] for text in named] == [
        f"the image of real/camera at {late_s:.3f} s"
    ]


async def test_a_paused_run_jumps_to_another_time_at_once_with_its_trails(tmp_path: Path) -> None:
    folder = write_campaign(tmp_path / "gate") / "large" / "wil" / "1"
    views: list[RunView] = []
    said: list[tuple[str, Mapping[str, Any]]] = []
    has_view = asyncio.Event()

    async def take(message: FeedMessage) -> None:
        if isinstance(message, RunView):
            views.append(message)
            has_view.set()

    playback = Playback(
        time=asyncio.get_running_loop().time, show=lambda kind, one: said.append((kind, one))
    )
    playing = asyncio.create_task(RecordedRun(folder, playback).play(take))
    await has_view.wait()
    playback.change({"paused": True, "t_s": GOAL_S + 1.0})
    has_view.clear()
    await has_view.wait()
    playing.cancel()
    await asyncio.wait({playing})
    assert views[-1].t_s == pytest.approx(GOAL_S + 1.0, abs=0.11)
    assert len(views) < 5, "nothing between is played"
    past = next(one for kind, one in said if kind == "past")
    assert past["trails"]["real"]
    (margins, before) = (views[-1].margins, views[0].margins)
    assert {one.name for one in before} == {margin.name for margin in margins}
    assert all(one.actual is None for one in before), "nothing is known at the start"


def test_playback_keeps_its_time_over_changes_of_pause_and_speed() -> None:
    now = [0.0]
    playback = Playback(2.0, time=lambda: now[0])
    playback.begin(10.0, 30.0)
    now[0] = 3.0
    assert playback.t_s == 16.0
    playback.change({"paused": True})
    now[0] = 50.0
    assert playback.t_s == 16.0
    playback.change({"paused": False, "speed": 0.5})
    now[0] = 52.0
    assert playback.t_s == 17.0
    playback.change({"t_s": 99})
    assert playback.state() == {
        "paused": False,
        "speed": 0.5,
        "t_s": 30.0,
        "first_s": 10.0,
        "last_s": 30.0,
    }


@pytest.mark.parametrize(
    "wanted",
    [{}, [], {"at": 1}, {"paused": 1}, {"speed": 0}, {"speed": True}, {"t_s": float("nan")}],
)
def test_a_playback_command_that_cannot_be_obeyed_is_refused(wanted: object) -> None:
    playback = Playback(time=lambda: 0.0)
    with pytest.raises(AccessError):
        playback.change(wanted)


@pytest.mark.parametrize(
    ("link", "kind"),
    [
        ("embedded", "simulated: embedded"),
        ({"launch": "px4"}, "simulated: px4"),
        ("udp:127.0.0.1:14550", "attached: may be hardware"),
        ({"url": "serial:/dev/ttyACM0"}, "attached: may be hardware"),
    ],
)
def test_the_scene_says_what_a_vehicle_is(link: object, kind: str) -> None:
    facts = {"campaign": json.dumps({"vehicles": {"real": {"link": link}}})}
    assert RunScene.of("/r", facts).document["kinds"] == {"real": kind}
    for broken in ("", "[]", "{", '{"vehicles": {"real": 1}}'):
        assert RunScene.of("/r", {"campaign": broken}).document["kinds"] == {}


async def test_a_run_without_positions_cannot_be_played(tmp_path: Path) -> None:
    folder = write_campaign(tmp_path / "gate") / "large" / "wil" / "1"
    (folder / "trajectory.csv").write_text("t_s,vehicle,stage\n")
    with pytest.raises(RecordingError, match="no row"):
        await played(folder)


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--address", "0.0.0.0"), 2, "needs a certificate"),  # noqa: S104
        (("--address", "a b"), 2, "not a console address"),
        (("--tls-cert", "x.pem"), 2, "go together"),
        (("--speed", "0"), 2, "--speed is between"),
        (("--speed", "4"), 2, "--speed is for a finished run"),
        (("not/there", "--speed", "4"), 2, "--speed is for a finished run"),
        (("not/there", "--address", "a b"), 2, "there is no folder not/there yet"),
    ],
)
def test_a_run_that_cannot_be_served_is_refused_in_words(
    arguments: tuple[str, ...], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["console", *arguments]) == code
    assert said in capsys.readouterr().err


def test_a_port_in_use_is_refused_in_words(
    capsys: pytest.CaptureFixture[str], unused_tcp_port: int
) -> None:
    import socket

    with socket.create_server(("127.0.0.1", unused_tcp_port)):
        assert main(["console", "--address", f":{unused_tcp_port}"]) == 3
    assert "cannot listen at" in capsys.readouterr().err
