"""The observer: it sees vehicles and world where geometry written out here says."""

import json
import math
import re
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from PIL import Image, ImageSequence

from tests.orchestrator.hover import write_hover
from tests.orchestrator.report import recorded_campaign
from tests.orchestrator.report.recorded_campaign import GOAL_S, write_campaign
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.recording.judge_log_file import JudgeLogWriter
from wil_campaign.orchestrator.recording.timestamps import VIRTUAL_EPOCH_S
from wil_campaign.orchestrator.report.campaign_report import write_report
from wil_campaign.plugins.observer.observed_run import (
    ObservedRun,
    ObserverCamera,
    read_observed_run,
)
from wil_campaign.safety.evaluation.judge_log import LoggedWorldEvent
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.readings import BgrImage
from wil_campaign.worlds.frames import Pose

AT_S = 3.5
"""The vehicles are 1.5 m north and 1.2 m up; real is 0.5 m east, the twin is not."""
ABOVE = {"north_m": 1.0, "east_m": 0.2, "up_m": 6.0, "yaw_deg": 0.0, "pitch_deg": -90.0}
OPTICS = {"width_px": 320, "height_px": 240, "fov_deg": 40.0, "rate_hz": 4.0}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recorded campaign with an observer above."""
    monkeypatch.setitem(recorded_campaign.CAMPAIGN, "observer", {**ABOVE, **OPTICS})
    return write_campaign(tmp_path / "gate")


def seen_by(folder: Path, mode: str) -> tuple[ObservedRun, ObserverCamera]:
    run = read_observed_run(folder / "large" / mode / "1")
    assert run.observer is not None
    return run, ObserverCamera(run, run.observer)


def middle_of(mask: Any) -> tuple[float, float, int]:
    """The middle (column, row) of what is set, and its width in pixels."""
    rows, columns = np.nonzero(mask)
    assert len(rows) > 20
    width = int(columns.max() - columns.min() + 1)
    return (columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2, width


def bluest(image: BgrImage) -> Any:
    """Where an image has the blue of the real vehicle: the ground is grey, the gate orange."""
    wide = image.astype(int)
    return wide[:, :, 0] - wide[:, :, 2] > 60


def pinkest(image: BgrImage) -> Any:
    wide = image.astype(int)
    return (wide[:, :, 2] - wide[:, :, 1] > 40) & (wide[:, :, 0] - wide[:, :, 1] > 15)


def test_a_vehicle_is_where_the_projection_from_above_says(folder: Path) -> None:
    """Straight down with north up: right is east; metres become pixels by focal over depth."""
    _, camera = seen_by(folder, "wil")
    image = camera.draw(AT_S, marked=False)
    focal_px = 160.0 / math.tan(math.radians(20.0))
    px_per_m = focal_px / (6.0 - 1.2)
    column, row, width = middle_of(bluest(image))
    assert column == pytest.approx(159.5 + px_per_m * (0.5 - 0.2), abs=2.0)
    assert row == pytest.approx(119.5 - px_per_m * (1.5 - 1.0), abs=2.0)
    assert width == pytest.approx(px_per_m * 0.3, rel=0.35)


def test_a_vehicle_is_where_the_projection_from_the_side_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Looking west at a place of the observer's own height: right is north."""
    beside = {"north_m": 1.2, "east_m": 4.0, "up_m": 1.0}
    look_at = {"north_m": 1.2, "east_m": 0.0, "up_m": 1.0}
    given = {**beside, "look_at": look_at, **OPTICS}
    monkeypatch.setitem(recorded_campaign.CAMPAIGN, "observer", given)
    _, camera = seen_by(write_campaign(tmp_path / "gate"), "wil")
    column, row, _ = middle_of(bluest(camera.draw(AT_S, marked=False)))
    focal_px = 160.0 / math.tan(math.radians(20.0))
    assert column == pytest.approx(159.5 + focal_px * (1.5 - 1.2) / 3.5, abs=2.0)
    assert row == pytest.approx(119.5 - focal_px * (1.2 - 1.0) / 3.5, abs=3.0)


def test_what_is_only_virtual_shines_through(folder: Path) -> None:
    """The twin and the gate are pale beside a real vehicle, and solid in simulation."""
    pale = seen_by(folder, "wil")[1].draw(AT_S, marked=False).astype(int)
    solid = seen_by(folder, "sim")[1].draw(AT_S, marked=False).astype(int)
    mask = pinkest(pale.astype(np.uint8)) & pinkest(solid.astype(np.uint8))
    column, _, _ = middle_of(mask)
    px_per_m = 160.0 / math.tan(math.radians(20.0)) / 4.8
    assert column == pytest.approx(159.5 + px_per_m * (0.0 - 0.2), abs=3.0)
    both = pale[mask], solid[mask]
    redness = [float((one[:, 2] - one[:, 1]).mean()) for one in both]
    assert 0.4 < redness[0] / redness[1] < 0.75


def test_rings_and_names_mark_the_vehicles(folder: Path) -> None:
    _, camera = seen_by(folder, "wil")
    plain, marked = camera.draw(AT_S, marked=False), camera.draw(AT_S)
    changed = (plain.astype(int) != marked.astype(int)).any(axis=2)
    place = camera.place_px("real", AT_S)
    assert place is not None
    x, y, radius = place
    rows, columns = np.nonzero(changed & bluest(marked))
    away = np.hypot(columns - x, rows - y)
    assert ((away > radius - 2) & (away < radius + 2)).sum() > 20


def test_the_report_of_a_run_has_its_moment_from_outside(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = write_report(folder, workers=1)
    page = written.path.read_text("utf-8")
    assert page.count("<h3>From outside</h3>") == 2
    assert page.count('alt="observer&#39;s image') == 2 * 5
    assert (
        len(
            re.findall(
                r'class="now"><button [^>]*><span[^>]*>[^<]*</span><img [^>]*"observer', page
            )
        )
        == 2
    )
    assert page.count("Pale: virtual objects and the twin") == 1
    (folder / "large/wil/1/judged.msgpack").write_bytes(b"")
    damaged = write_report(folder, workers=1)
    assert any("observer's images are left out" in text for text in damaged.problems)
    monkeypatch.delitem(recorded_campaign.CAMPAIGN, "observer")
    plain = write_report(write_campaign(tmp_path / "plain"), workers=1).path.read_text("utf-8")
    assert "From outside" not in plain


def test_actors_and_events_move_the_world_of_the_observer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A box that begins to move with the goal, at 1 m/s north."""
    box: dict[str, Any] = {
        "shape": {"box": {"size_m": [0.3, 0.3, 0.3]}},
        "pose": {"north_m": 0.0, "east_m": -0.6, "up_m": 1.0},
        "color": "green",
        "motion": {"waypoints": [{"north_m": 3, "east_m": -0.6, "up_m": 1.0, "speed_m_s": 1.0}]},
    }
    monkeypatch.setitem(recorded_campaign.WORLD, "objects", {"box": box})
    monkeypatch.setitem(recorded_campaign.CAMPAIGN, "observer", {**ABOVE, **OPTICS})
    place = write_campaign(tmp_path / "gate") / "large" / "sim" / "1"
    (place / "judged.msgpack").unlink()
    with JudgeLogWriter(path=place / "judged.msgpack") as judged:
        judged.write(LoggedWorldEvent(GOAL_S, "goal"))
        for t_s in (0.0, 6.0):
            judged.write(PoseSample(t_s, "twin", Pose.of(0.0, 0.5, 1.0), (0.0, 0.0, 0.0)))
    run = read_observed_run(place)
    assert run.observer is not None
    image = ObserverCamera(run, run.observer).draw(AT_S, marked=False).astype(int)
    _, row, _ = middle_of(image[:, :, 1] - image[:, :, 2] > 40)
    px_per_m = 160.0 / math.tan(math.radians(20.0)) / 4.85
    assert row == pytest.approx(119.5 - px_per_m * ((AT_S - GOAL_S) * 1.0 - 1.0), abs=3.0)


def test_film_writes_video_picture_and_topic(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = folder / "large" / "wil" / "1"
    for name in ("a.mp4", "a.gif", "a.mcap", "a.png"):
        assert main(["film", str(run), "--out", name]) == 0
        assert f"film: {run / name}" in capsys.readouterr().out
    assert not list(run.glob(".*part"))
    frames = round((recorded_campaign.END_S - 0.5) * 4.0) + 1
    with av.open(str(run / "a.mp4")) as video:
        assert len(list(video.decode(video=0))) == frames
    with Image.open(run / "a.gif") as picture:
        # Equal images, as on the ground, are one that is shown for longer.
        shown = [one.info["duration"] for one in ImageSequence.Iterator(picture)]
    assert len(shown) > 8
    assert sum(shown) == frames * 250
    image = cv2.imread(str(run / "a.png"))
    assert image is not None
    assert image.shape == (240, 320, 3)
    with (run / "a.mcap").open("rb") as stream:
        messages = list(make_reader(stream).iter_messages())
    assert {channel.topic for _, channel, _ in messages} == {"/observer/camera"}
    schema, _, first = messages[0]
    assert schema is not None
    assert (len(messages), schema.name) == (frames, "foxglove.CompressedImage")
    assert first.log_time == round((VIRTUAL_EPOCH_S + 0.5) * 1e9)
    assert json.loads(first.data)["format"] == "jpeg"


def test_film_without_the_key_looks_at_the_whole_flight(tmp_path: Path) -> None:
    run = write_campaign(tmp_path / "gate") / "large" / "sim" / "1"
    seen = read_observed_run(run)
    assert seen.observer is None
    camera = ObserverCamera(seen, seen.default_observer)
    for t_s in (GOAL_S, 3.0, 4.0, 5.0):
        place = camera.place_px("twin", t_s)
        assert place is not None
        assert 0 < place[0] < 640
        assert 0 < place[1] < 480
    assert main(["film", str(run), "--out", str(tmp_path / "b.png")]) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["film", "{run}", "--out", "a.avi"], "the name must end in .mp4, .gif, .mcap, .png"),
        (["film", "{run}/..", "--out", "a.mp4"], "has no world of a flight"),
        (["film", "{run}", "--out", "{run}/run.mcap"], "is of the flight itself"),
    ],
)
def test_film_refuses_with_the_remedy(
    folder: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run = folder / "large" / "wil" / "1"
    assert main([argument.format(run=run) for argument in arguments]) == 2
    assert message in capsys.readouterr().err
    assert main(["film", str(run), "--out", str(folder / "none" / "a.mp4")]) == 3


@pytest.mark.parametrize(
    ("observer", "message"),
    [
        ("{north_m: 0, east_m: 0, up_m: 2}", "exactly one of 'look_at' and 'yaw_deg'"),
        (
            "{north_m: 0, east_m: 0, up_m: 2, look_at: {up_m: 2}}",
            "the observer stands there itself",
        ),
        (
            "{north_m: 0, east_m: 0, up_m: 2, look_at: {}, pitch_deg: 3}",
            "look_at determines this already",
        ),
        (
            "{north_m: 0, east_m: 0, up_m: 2, yaw_deg: 0, fov_deg: 5.0e-324}",
            "must be at least 0.001",
        ),
    ],
)
def test_a_faulty_observer_is_refused_with_its_line(
    tmp_path: Path, observer: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_hover(tmp_path)
    path.write_text(f"{path.read_text('utf-8')}\nobserver: {observer}\n", "utf-8")
    assert main(["validate", str(path)]) == 2
    assert message in capsys.readouterr().err
    text = path.read_text("utf-8").replace(observer, "{north_m: 0, east_m: 0, up_m: 2, yaw_deg: 9}")
    path.write_text(text, "utf-8")
    assert main(["validate", str(path)]) == 0
