"""The pictures of a run that people share: written whole, of the right run, at the right times."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.orchestrator.mcap_runs import recorder
from tests.orchestrator.report.recorded_campaign import GOAL_S, TOUCHED_S, write_campaign
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.recording.mcap.mcap_settings import EXACT, RecordingSettings
from wil_campaign.orchestrator.report.model import RunReport
from wil_campaign.orchestrator.report.reading.run_reader import read_run
from wil_campaign.orchestrator.report.reading.sight_decoding import ImageSize
from wil_campaign.orchestrator.run_results.control_results import ControlResult
from wil_campaign.orchestrator.run_results.run_result import EarlierAttempt, LaterEvent
from wil_campaign.plugins.run_images.card import SIZE_PX, draw_card, role_mark
from wil_campaign.plugins.run_images.drawing import (
    DIM,
    SUBJECTS,
    VERDICTS,
    DrawingSheet,
    Spot,
    drawable_text,
)
from wil_campaign.plugins.run_images.image_writer import write_card, write_moving_picture
from wil_campaign.plugins.run_images.recorded_images import (
    ImagesAtTime,
    most_mixed,
    read_images,
)
from wil_campaign.safety.model.oracle_results import Verdict
from wil_campaign.vehicles.perception.depth_colors import color_depth, depth_scale
from wil_campaign.vehicles.readings import CameraReading, DepthReading, Drawing
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_campaign(tmp_path / "gate")


def has_colour(path: Path, rgb: tuple[int, int, int]) -> bool:
    with Image.open(path) as image:
        pixels = np.asarray(image.convert("RGB"))
    return bool((pixels == rgb).all(axis=2).any())


def test_a_card_has_the_verdict_the_paths_and_the_failed_run_first(folder: Path) -> None:
    path = write_card(folder)
    assert path == folder / "large/wil/1/card.png"
    with Image.open(path) as image:
        assert image.size == SIZE_PX
    colours = (VERDICTS["FAIL"], SUBJECTS["real"], SUBJECTS["twin"])
    assert all(has_colour(path, colour) for colour in colours)
    passed = write_card(folder, "large/sim/1")
    assert has_colour(passed, VERDICTS["PASS"])


def test_a_moving_picture_lasts_as_long_as_the_flight_from_the_goal_on(folder: Path) -> None:
    path = write_moving_picture(folder, "large/wil/1")
    with Image.open(path) as image:
        shown_ms = []
        for frame in range(getattr(image, "n_frames", 1)):
            image.seek(frame)
            shown_ms.append(image.info["duration"])
    # From the goal to 2 s after the contact, and the last frame stays.
    assert sum(shown_ms[:-1]) == pytest.approx(1000.0 * (TOUCHED_S + 2.0 - GOAL_S), abs=250.0)
    assert shown_ms[-1] == 2500


def test_the_images_are_those_of_the_times(folder: Path) -> None:
    found = read_images(folder / "large/wil/1", mode="wil", wanted_s=[3.0, 5.0])
    assert [one.t_s for one in found] == [3.0, 5.0]
    assert all(set(one.images_bgr) == {"real", "twin", "mixed"} for one in found)
    # The grey of the fixture tells the time of the exposure.
    greys = [int(one.images_bgr["mixed"].mean()) for one in found]
    assert greys[1] - greys[0] == pytest.approx(80, abs=6)
    (alone,) = read_images(folder / "large/sim/1", mode="sim", wanted_s=[3.0])
    assert set(alone.images_bgr) == {"twin"}


def test_the_images_that_show_most_of_the_virtual_world_are_chosen() -> None:
    def images(t_s: float, mixed: int) -> ImagesAtTime:
        grey = np.full((4, 4, 3), 100, np.uint8)
        return ImagesAtTime(t_s, {"real": grey, "mixed": np.full_like(grey, mixed)})

    chosen = most_mixed([images(1.0, 120), images(2.0, 150), images(3.0, 100)])
    assert chosen is not None
    assert chosen.t_s == 2.0
    last = most_mixed([images(1.0, 100), images(2.0, 100)])
    assert last is not None
    assert last.t_s == 2.0
    assert most_mixed([]) is None


def test_a_run_without_images_has_a_card_and_no_moving_picture(folder: Path) -> None:
    (folder / "large/wil/1/run.mcap").unlink()
    assert write_card(folder).stat().st_size > 1000
    with pytest.raises(ResultsFolderError, match="no images of large/wil/1"):
        write_moving_picture(folder)


def test_the_card_of_a_failure_with_unsound_evidence_says_so(folder: Path) -> None:
    campaign = read_campaign_documents(folder)
    run = read_run(folder, campaign.entries[0], ImageSize.for_runs(1))
    assert run.result is not None
    unseen = LaterEvent("INVALID", "mixing of camera: the mixture never showed gate", 9.0)
    doubted = replace(run, result=replace(run.result, verdict="FAIL", also=(unseen,)))
    for shown, is_said in ((run, False), (doubted, True)):
        draw_card(shown, "gate", None).image.save(folder / "card.png")
        assert has_colour(folder / "card.png", VERDICTS["INVALID"]) is is_said


def with_control(run: RunReport, verdict: Verdict, *, met: bool) -> RunReport:
    assert run.result is not None
    control = ControlResult("large", "FAIL", "reached", None, met)
    return replace(run, result=replace(run.result, verdict=verdict, control=control))


def test_a_control_has_the_colour_of_how_it_had_to_end(folder: Path) -> None:
    """A control that passed had the green card of a success."""
    campaign = read_campaign_documents(folder)
    run = read_run(folder, campaign.entries[0], ImageSize.for_runs(1))
    wrong, met = with_control(run, "PASS", met=False), with_control(run, "FAIL", met=True)
    assert [role_mark(one)[0] for one in (run, wrong, met)] == [
        "required",
        "control, NOT met",
        "control, met",
    ]
    draw_card(wrong, "gate", None).image.save(folder / "card.png")
    assert not has_colour(folder / "card.png", VERDICTS["PASS"])
    assert role_mark(wrong)[2] == VERDICTS["FAIL"]
    assert role_mark(met)[2] == DIM


def test_a_pass_at_a_second_attempt_says_so(folder: Path) -> None:
    campaign = read_campaign_documents(folder)
    run = read_run(folder, campaign.entries[0], ImageSize.for_runs(1))
    assert run.result is not None
    again = replace(run.result, attempts=(EarlierAttempt("INVALID", "no pose", "earlier/1"),))
    assert role_mark(replace(run, result=again))[0] == "required, attempt 2"


def test_no_letter_is_drawn_that_the_font_lacks() -> None:
    """ "landed" had two boxes for what it does not measure, and a name its umlauts."""
    assert (
        drawable_text("Tür \N{EN DASH} 0.1 \N{MULTIPLICATION SIGN} 2\N{DEGREE SIGN}… ≤ 門")
        == "Tur - 0.1 x 2\N{DEGREE SIGN}... ? ?"
    )


def test_a_flight_of_the_twin_alone_is_not_called_world_in_the_loop(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[str] = []
    draw = DrawingSheet.text

    def text(sheet: DrawingSheet, at: Spot, line: str, *more: Any) -> float:
        drawn.append(line)
        return draw(sheet, at, line, *more)

    monkeypatch.setattr(DrawingSheet, "text", text)
    for name, is_mixed in (("large/sim/1", False), ("large/wil/1", True)):
        drawn.clear()
        write_card(folder, name)
        assert any("world-in-the-loop" in line for line in drawn) is is_mixed
    assert drawn


def test_colours_of_depths_have_their_scale_on_the_card(folder: Path) -> None:
    campaign = read_campaign_documents(folder)
    run = read_run(folder, campaign.entries[0], ImageSize.for_runs(1))
    nearest: tuple[int, int, int] = tuple(depth_scale(1, 1)[0, 0, ::-1].tolist())
    for far_m in (None, 3.0):
        images = ImagesAtTime(0.0, {}, far_m)
        draw_card(run, "gate", images).image.save(folder / "card.png")
        assert has_colour(folder / "card.png", nearest) is (far_m is not None)


def test_recorded_depths_are_known_as_such(folder: Path) -> None:
    place = folder / "large/sim/1"
    assert not any(one.far_m for one in read_images(place, mode="sim", wanted_s=[5.0]))
    (place / "run.mcap").unlink()
    with recorder(place / "run.mcap", settings=RecordingSettings(), facts={}) as run:
        for seq in range(1, 200):
            reading = DepthReading(
                t_s=0.05 * seq,
                arrived_s=0.05 * seq,
                seq=seq,
                source="twin",
                depth_m=np.full((8, 8), 1.0 if seq < 120 else 4.2, np.float32),
                intrinsics=Intrinsics.from_fov(8, 8, 1.0),
            )
            run.reading("depth", reading)
    near, far = read_images(place, mode="sim", wanted_s=[5.0, 8.0])
    assert (near.far_m, far.far_m) == (5.0, 5.0), "one scale, to what is seen at any time"
    one_metre = color_depth(np.ones((1, 1), np.float32), 5.0)
    assert (near.images_bgr["twin"][0, 0] == one_metre[0, 0]).all()


def test_an_unknown_run_and_one_without_a_folder_are_named(folder: Path) -> None:
    with pytest.raises(ResultsFolderError, match=r"--run small/wil/1: no run of .*large/sim/1"):
        write_card(folder, "small/wil/1")
    shutil.rmtree(folder / "large/wil/1")
    with pytest.raises(ResultsFolderError, match="large/wil/1: the run was not flown"):
        write_card(folder, "large/wil/1")


def test_a_card_whose_images_cannot_be_drawn_again_costs_no_report(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A mesh of the world was moved: the report was not written either."""
    place = folder / "large/sim/1/run.mcap"
    place.unlink()
    settings = RecordingSettings(twin=replace(EXACT, keeps_drawn=False))
    with recorder(place, settings=settings, facts={}) as run:
        for seq in range(1, 200):
            reading = CameraReading(
                t_s=0.05 * seq,
                arrived_s=0.05 * seq,
                seq=seq,
                source="twin",
                image_bgr=np.zeros((8, 8, 3), np.uint8),
                intrinsics=Intrinsics.from_fov(8, 8, 1.0),
                drawing=Drawing(Pose((0.0, 0.0, 0.0))),
            )
            run.reading("camera", reading)
    assert main(["report", str(folder), "--card", "--run", "large/sim/1"]) == 3
    assert (folder / "report.html").is_file()
    assert "no --card: large/sim/1: the image of twin/camera at " in capsys.readouterr().err


def test_the_command_writes_both_and_names_them(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(folder), "--card", "--gif"]) == 0
    said = capsys.readouterr().out
    assert f"picture: {folder}/large/wil/1/card.png" in said
    assert f"picture: {folder}/large/wil/1/flight.gif" in said
    assert main(["report", str(folder), "--run", "large/wil/1"]) == 2
    assert "--run large/wil/1 needs --card or --gif" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "write"), [("card.png", write_card), ("flight.gif", write_moving_picture)]
)
def test_a_stop_leaves_the_picture_that_was_there(
    folder: Path, monkeypatch: pytest.MonkeyPatch, name: str, write: Callable[[Path, str], Path]
) -> None:
    def stopped(image: Image.Image, place: Path | BytesIO, **options: Any) -> None:
        del image, options
        if isinstance(place, Path):
            place.write_bytes(b"half")
        raise KeyboardInterrupt

    path = folder / "large/wil/1" / name
    path.write_bytes(b"before")
    monkeypatch.setattr(Image.Image, "save", stopped)
    with pytest.raises(KeyboardInterrupt):
        write(folder, "large/wil/1")
    assert path.read_bytes() == b"before"
    monkeypatch.undo()
    last = path.with_suffix(".last")
    last.hardlink_to(path)
    assert write(folder, "large/wil/1").stat().st_size > 1000
    assert last.read_bytes() == b"before"  # no moment at which half of one stands there


def test_a_line_that_is_too_long_is_cut_and_a_text_wraps() -> None:
    sheet = DrawingSheet(200, 100)
    cut = sheet.fitted("a very long sentence about a flight", 14, 100.0)
    assert cut.endswith("…")
    assert sheet.width_of(cut, 14) <= 100.0
    lines = sheet.wrapped("one two three four five six seven eight nine ten", 14, 100.0, 2)
    assert len(lines) == 2
    assert lines[0].startswith("one two")
    assert lines[1].endswith("…")
