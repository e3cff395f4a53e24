"""A flight in virtual time for Foxglove: what is live is what run.mcap has."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from tests.orchestrator.conftest import BRIEF
from tests.plugins.foxglove.foxglove_client import Received, listening, never_reading
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.foxglove.bridge_beside import foxglove_beside

Fly = Callable[..., tuple[RunResult, Path]]
POSES = tuple(f"vehicles.{name}.sensors.pose={{type: pose}}" for name in ("real", "twin"))
CAPTURED = tuple(f"vehicles.{name}.pose_source=mocap" for name in ("real", "twin"))


def recorded(folder: Path) -> tuple[dict[str, tuple[str, bytes, str]], dict[str, list[Any]]]:
    """Return of each topic of run.mcap its schema and encoding, and its messages."""
    channels: dict[str, tuple[str, bytes, str]] = {}
    messages: dict[str, list[Any]] = {}
    with (folder / "run.mcap").open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            channels[channel.topic] = (schema.name, schema.data, channel.message_encoding)
            messages.setdefault(channel.topic, []).append(json.loads(message.data))
    return channels, messages


def assert_live_as_recorded(seen: Received, folder: Path) -> None:
    channels, messages = recorded(folder)
    live = {channel["topic"]: channel for channel in seen.channels.values()}
    assert live.keys() - channels.keys() == {"/run"}
    for topic in live.keys() & channels.keys():
        one = live[topic]
        assert (one["schemaName"], one["schema"].encode(), one["encoding"]) == channels[topic]
    for name in ("real", "twin"):
        poses = {one["wil"]["t_s"]: one for one in messages[f"/{name}/pose"]}
        # Readings are recorded from the takeoff on; vehicles are shown before, too.
        shown = [one for one in seen.of(f"/{name}/pose") if one["wil"]["t_s"] >= min(poses)]
        assert len({one["wil"]["t_s"] for one in shown}) > 3
        for one in shown:
            same = poses[one["wil"]["t_s"]]
            for key in ("timestamp", "frame_id", "pose"):
                assert one[key] == same[key]
        places = [one for one in messages["/tf"] if one["child_frame_id"] == name]
        moved = [one for one in seen.of("/tf") if one["child_frame_id"] == name]
        assert [one for one in moved if one in places] == moved[-len(shown) :]
        taken = {(one["wil"]["seq"], one["wil"]["t_s"]) for one in messages[f"/{name}/camera"]}
        images = seen.of(f"/{name}/camera")
        assert {(image["wil"]["seq"], image["wil"]["t_s"]) for image in images} <= taken
    assert messages["/tf"][0] in seen.of("/tf")
    of_recording = {"recorder", "perceived", "images_ended"}
    lines = [one for one in messages["/log"] if one["name"] not in of_recording]
    shown = [one for one in seen.of("/log") if one in lines]
    # In order and without a gap, from the subscription on. The end is not waited for: a run ends
    # without its viewers.
    assert shown
    begin = lines.index(shown[0])
    assert shown == lines[begin : begin + len(shown)]
    assert "goal" in {one["message"] for one in shown}


def test_live_messages_equal_run_mcap_and_no_client_changes_the_flight(
    fly_run: Fly, short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))
    sets = (*BRIEF, *POSES, *CAPTURED, "record={pictures: jpeg}")
    said: list[str] = []
    are_subscribed: list[bool] = []

    def wait_for_client(progress: object) -> None:
        """Let the flight wait: in its first moment for the client, in the air for poses of it."""
        if not are_subscribed:
            are_subscribed.append(seen.has_subscribed("/log"))
        if getattr(progress, "stage", "") not in {"takeoff", "at_height", "goal", "land"}:
            return
        count, give_up_s = len(seen.of("/twin/pose")), time.monotonic() + 0.1
        while len(seen.of("/twin/pose")) == count and time.monotonic() < give_up_s:
            time.sleep(0.01)

    with (
        foxglove_beside("127.0.0.1:0", said.append),
        foxglove_beside("127.0.0.1:0", said.append, folder=short_folder),
    ):
        url, of_others = (one.removeprefix("foxglove: ") for one in said)
        port = int(url.rpartition(":")[2])
        with (
            listening(url) as seen,
            listening(of_others) as nothing,
            never_reading(port, channels=5),
        ):
            # A flight in virtual time is soon over.
            watched, folder = fly_run(sets=sets, report=wait_for_client)
            assert are_subscribed == [True]
            seen.has("/log", name="stage", text="end")
        assert nothing.of("/run") == nothing.of("/log") == []
    assert watched.verdict == "PASS"
    assert_live_as_recorded(seen, folder)
    assert {tuple(greeting["capabilities"]) for greeting in seen.greetings} == {("time",)}
    assert {statuse["message"] for statuse in seen.statuses} == {
        "Server does not support clientPublish capability"
    }
    states = seen.of("/run")
    assert {state["name"] for state in states} == {"large/wil/1"}
    assert any(state["margins"] and len(state["vehicles"]) == 2 for state in states)
