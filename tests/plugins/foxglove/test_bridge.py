"""The Foxglove bridge without a flight: addresses, which run is shown, and clients that stand."""

import json
import socket
import sys
import time
from pathlib import Path

import pytest
from msgspec import structs

from tests.plugins.console.test_console_server import view
from tests.plugins.foxglove.foxglove_client import (
    PATIENCE_S,
    listening,
    never_reading,
)
from wil_campaign.orchestrator.cli import main
from wil_campaign.plugins.console.console_address import ConsoleAddress
from wil_campaign.plugins.console.feed.feed_messages import (
    EventView,
    FactsView,
    ImageView,
    VehicleView,
)
from wil_campaign.plugins.foxglove.bridge import FoxgloveBridge
from wil_campaign.plugins.foxglove.bridge_address import bridge_address
from wil_campaign.plugins.foxglove.bridge_beside import foxglove_beside
from wil_campaign.plugins.foxglove.errors import BridgeError
from wil_campaign.plugins.foxglove.followed_run import SILENT_S, FollowedRun
from wil_campaign.plugins.foxglove.foxglove_server import FoxgloveServer
from wil_campaign.plugins.foxglove.live_messages import LiveMessages
from wil_campaign.worlds.camera import CameraMount
from wil_campaign.worlds.frames import Pose

FREE = ConsoleAddress("127.0.0.1", 0)
EPOCH_NS = 1_700_000_000_000_000_000
IMAGES = 800
LARGE = b"\xff" * 50_000


def event(run: str, kind: str = "flag", word: str = "height", number: int = 1) -> EventView:
    return EventView(run, number, 2.0, kind, word, "real", "said")


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        ("auto", "127.0.0.1", 8765),
        (":9000", "127.0.0.1", 9000),
        ("localhost", "localhost", 8765),
        ("[::1]:9000", "::1", 9000),
    ],
)
def test_an_address_of_this_machine_is_taken(text: str, host: str, port: int) -> None:
    assert bridge_address(text) == ConsoleAddress(host, port)


@pytest.mark.parametrize("text", ["192.0.2.7", "0.0.0.0:8765", "lab.example", "[::]:1"])
def test_an_address_that_others_reach_is_refused(text: str) -> None:
    with pytest.raises(BridgeError, match=r"other machines.*ssh -L"):
        bridge_address(text)


@pytest.mark.parametrize("text", ["a b", ":99999", "http://127.0.0.1:1"])
def test_a_text_that_is_no_foxglove_address_is_refused(text: str) -> None:
    with pytest.raises(BridgeError, match="not an address for Foxglove"):
        bridge_address(text)


def test_an_address_in_use_is_refused_before_anything_flies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        address = f"127.0.0.1:{other.getsockname()[1]}"
        given = ["run", "campaigns/gate.yaml", "--out", str(tmp_path), "--foxglove", address]
        assert main(given) == 2
    assert f"cannot serve Foxglove at {address}" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_console_refuses_a_foreign_address_and_a_finished_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["console", "--foxglove", "192.0.2.7"]) == 2
    assert "can be reached by other machines" in capsys.readouterr().err
    for name in ("run.mcap", "result.json"):
        (tmp_path / name).touch()
    assert main(["console", str(tmp_path), "--foxglove", "auto"]) == 2
    assert "run.mcap in Foxglove" in capsys.readouterr().err


def test_where_the_extra_is_missing_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(BridgeError, match=r"pip install 'wil-campaign\[foxglove\]'"):
        FoxgloveServer(FREE).__enter__()


def test_a_bridge_that_ends_at_once_is_an_error_of_its_own(
    monkeypatch: pytest.MonkeyPatch, short_folder: Path
) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(BridgeError, match="did not start"), foxglove_beside("auto", print):
        raise AssertionError


def test_one_run_is_followed_until_it_ends_or_falls_silent() -> None:
    followed = FollowedRun()
    assert followed.follows(event("/a"), 0.0)
    assert not followed.follows(event("/b"), 0.1)
    assert followed.follows(event("/a", "stage", "end"), 0.2)
    assert followed.follows(event("/b"), 0.3)
    assert not followed.follows(event("/a"), 0.4)
    assert not followed.follows(event("/c"), SILENT_S)
    assert followed.follows(event("/c"), SILENT_S + 0.4)
    assert followed.run == "/c"


@pytest.mark.parametrize(
    ("kind", "severity", "level", "name", "text"),
    [
        ("stage", None, 2, "stage", "height"),
        ("decisive", None, 4, "height", "said"),
        ("contact", None, 3, "height", "said"),
        ("guard", None, 3, "guard real", "said"),
        ("vehicle", 2, 5, "vehicle real", "said"),
        ("vehicle", 4, 3, "vehicle real", "said"),
        ("vehicle", 7, 1, "vehicle real", "said"),
        ("vehicle", None, 2, "vehicle real", "said"),
    ],
)
def test_events_are_lines_of_the_log(
    kind: str, severity: int | None, level: int, name: str, text: str
) -> None:
    one = structs.replace(event("/r", kind), severity=severity)
    (line,) = LiveMessages(EPOCH_NS).of(one)
    document = json.loads(line.data)
    assert (document["level"], document["name"], document["message"]) == (level, name, text)
    assert (line.channel.topic, line.log_ns) == ("/log", EPOCH_NS + 2_000_000_000)


def test_a_vehicle_whose_place_is_unknown_has_no_pose() -> None:
    known = VehicleView(
        name="twin",
        armed=True,
        mode="",
        landed="",
        link_up=True,
        failsafe=False,
        position_ned_m=(1.0, 2.0, -3.0),
        q_wxyz=(1.0, 0.0, 0.0, 0.0),
        pose_t_s=1.5,
    )
    unknown = structs.replace(known, name="real", q_wxyz=None)
    messages = LiveMessages(EPOCH_NS).of(structs.replace(view(2.0), vehicles=(known, unknown)))
    assert [message.channel.topic for message in messages] == ["/twin/pose", "/tf", "/run"]
    assert json.loads(messages[0].data)["pose"]["position"] == {"x": 1.0, "y": 2.0, "z": -3.0}
    assert messages[0].publish_ns == EPOCH_NS + 1_500_000_000


def test_the_mounts_of_a_run_place_its_cameras_in_the_live_view() -> None:
    mounts = {
        "real/camera": CameraMount(Pose((0.1, 0.0, 0.0))),
        "twin/gimbal": CameraMount(stabilized=True),
    }
    messages = LiveMessages(EPOCH_NS, mounts)
    fixed = [json.loads(fixed_transform.data) for fixed_transform in messages.fixed_transforms()]
    assert [(one["parent_frame_id"], one["child_frame_id"]) for one in fixed] == [
        ("map", "ned"),
        ("real", "real/camera"),
    ]
    (shown,) = messages.of(image(1))
    assert json.loads(shown.data)["frame_id"] == "real/camera"


def image(number: int) -> ImageView:
    return ImageView(
        "/a", "mixed", number, 1.0, 0.0, 4, 4, rendered=False, jpeg=LARGE, source="mixed",
        sensor="camera", arrived_s=1.1,
    )  # fmt: skip


def test_the_next_run_resets_clients_and_one_that_never_reads_delays_none() -> None:
    with FoxgloveServer(FREE) as server, listening(server.url) as seen:
        port = int(server.url.rpartition(":")[2])
        bridge = FoxgloveBridge(server)
        bridge.receive(image(0), 0.0)  # Its clock is not known yet.
        for run in ("/a", "/b"):
            bridge.receive(FactsView(run, {"epoch_ns": str(EPOCH_NS)}), 0.0)
        while not (seen.of("/tf") and seen.of("/mixed/camera")):
            bridge.receive(image(1), time.monotonic())
            time.sleep(0.05)
        now_s = time.monotonic()
        with never_reading(port, channels=max(seen.channels)):
            time.sleep(0.2)
            began_s = time.monotonic()
            for number in range(2, IMAGES):
                bridge.receive(image(number), now_s)
            assert time.monotonic() - began_s < PATIENCE_S
            bridge.receive(event("/a", "stage", "end"), now_s)
            assert seen.has("/log", name="stage", text="end")
        bridge.receive(event("/b"), now_s)
        assert seen.has("/log", name="height", text="said")
    assert [greeting["sessionId"] for greeting in seen.greetings][-2:] == ["/a", "/b"]
    numbers = [one["wil"]["seq"] for one in seen.of("/mixed/camera")]
    assert 0 not in numbers
    assert numbers[-1] == IMAGES - 1
