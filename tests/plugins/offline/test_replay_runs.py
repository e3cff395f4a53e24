"""`wil-campaign replay`: a recorded run mixed anew to the bit, and where a recipe differs."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.orchestrator.conftest import SMALL_CAMERAS
from tests.orchestrator.run.perception.test_perception import SMALLEST, Listening, recipe
from tests.recipes.samples import beam, camera, cloud, plain, scan
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.recording.mcap.mcap_chunks import RecordStreamEnd
from wil_campaign.orchestrator.recording.mcap.mcap_writer import McapRecorder
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.offline.reading_difference import difference_of_readings
from wil_campaign.plugins.offline.recorded_inputs import recording_lack_text
from wil_campaign.plugins.python.mcap_reader import Recording
from wil_campaign.recipes.language.recipe_files import load_recipe_file
from wil_campaign.recipes.pipeline.pipeline import compile_recipe

Fly = Callable[..., tuple[RunResult, Path]]
RECIPE = """\
schema: wil/recipe/1
sensors: {camera: {type: camera}, imu: {type: imu}, ear: {type: microphone}, scan: {type: lidar}}
combine:
  - sensor: camera
    transform: [register]
    filter: [{isolate_objects: [gate]}, {use: "mine.py:Right"}]
    merge: overlay
  - {sensor: imu, transform: [{delay: 20}, {resample: interpolate}], merge: {aggregate: mean}}
  - {sensor: ear, filter: [{band_pass: {low_hz: 300}}], merge: add}
  - {sensor: scan, transform: [register], merge: {aggregate: min}}
"""
MINE = """\
import numpy as np
from wil_campaign.recipes.working import Masked

class Right:
    def __call__(self, work, other):
        mask = work.mask.copy()
        mask[:, : mask.shape[1] // 2] = 0
        return Masked(work.reading, mask)
"""
EARS = (
    "vehicles.real.sensors.ear={type: microphone, block_samples: 1024}",
    "vehicles.twin.sensors.ear={type: microphone, block_samples: 400}",
)
CARRIED = tuple(
    f"vehicles.{vehicle}.sensors.{name}={what}"
    for vehicle in ("real", "twin")
    for name, what in {
        "camera": "{type: camera, rate_hz: 5, width_px: 160, height_px: 120, fov_deg: 69}",
        "imu": "{type: imu, rate_hz: 50}",
        "scan": "{type: lidar, beams: 60, rate_hz: 5}",
    }.items()
)


@pytest.fixture
def run_of(fly_run: Fly, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Path]:
    """Return a function that flies a second of a mixed run and returns its folder."""
    Listening.made = []
    monkeypatch.setattr(
        "wil_campaign.campaigns.setup.autonomy_under_test.find_autonomy", lambda *_: Listening
    )
    (tmp_path / "mine.py").write_text(MINE)

    def fly(pictures: str) -> Path:
        sets = (*CARRIED, *EARS, recipe(tmp_path, RECIPE), f"record.pictures={pictures}")
        _, folder = fly_run(cameras=SMALL_CAMERAS, sets=sets)
        return folder

    return fly


def replayed(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    code = main(["replay", *arguments, "--trust", "--json"])
    told = capsys.readouterr()
    assert "Traceback" not in told.err
    return code, json.loads(told.out)


def test_a_run_mixed_anew_equals_its_recording(
    run_of: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = run_of("raw")
    code, report = replayed(capsys, str(folder))
    assert (code, report["diverges"], report["without"]) == (0, False, [])
    combinations = {one["name"]: one for one in report["combinations"]}
    assert set(combinations) == {"camera", "imu", "ear", "scan"}
    assert all(
        combination["exact"] and combination["frames"] > 20 for combination in combinations.values()
    )
    assert all(
        combination["mixed"] >= combination["frames"] - 3 for combination in combinations.values()
    )

    # Another recipe: here the left half is drawn instead, and nothing else changes.
    left = MINE.replace(": mask.shape[1] // 2", "mask.shape[1] // 2 :")
    assert left != MINE
    (tmp_path / "other.py").write_text(left)
    other, out = tmp_path / "other.yaml", tmp_path / "out"
    other.write_text(RECIPE.replace("mine.py", "other.py"))
    more = ("--recipe", str(other), "--out", str(out))
    code, report = replayed(capsys, str(folder / "run.mcap"), *more)
    assert (code, report["diverges"]) == (1, True)
    combinations = {one["name"]: one for one in report["combinations"]}
    assert not any(combinations[name]["divergences"] for name in ("imu", "ear", "scan"))
    first = combinations["camera"]["divergences"][0]
    assert "of image_bgr, by up to" in first["what"]
    worst = cv2.imread(str(out / "worst-camera.png"))
    assert worst is not None
    assert worst.shape == (120, 3 * 160, 3)
    assert (out / "mixed.mp4").is_file()

    # A recipe that does not mix a sensor at all leaves recorded mixtures without a partner.
    fewer = tmp_path / "fewer.yaml"
    fewer.write_text(RECIPE.replace("  - {sensor: scan", "#"))
    code, report = replayed(capsys, str(folder), "--recipe", str(fewer))
    assert (code, report["without"]) == (1, ["scan"])

    # A run that was cut short is replayed as far as it goes.
    whole = (folder / "run.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    code, report = replayed(capsys, str(cut))
    assert code == 3
    assert 10 < report["combinations"][0]["frames"] < combinations["camera"]["frames"]
    assert report["lacks"].startswith("the recording is cut after byte ")


TIMED = """\
schema: wil/recipe/1
sensors: {camera: {type: camera, rate_hz: 5}, imu: {type: imu, rate_hz: 20}}
combine:
  - sensor: camera
    transform: [register, {delay: {by_ms: 90, on: real}}]
    merge: overlay
    max_skew_ms: 300
  - {sensor: imu, transform: [{delay: {by_ms: 15, on: real}}], merge: {aggregate: mean}}
"""
"""Mixes every second image and every fifth reading of the IMU: the others are offered only."""


def test_steps_that_select_by_time_also_get_images_not_due_in_a_replay(
    fly_run: Fly,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    Listening.made = []
    monkeypatch.setattr(
        "wil_campaign.campaigns.setup.autonomy_under_test.find_autonomy", lambda *_: Listening
    )
    rates = tuple(
        f"vehicles.{name}.sensors.{key}"
        for name in ("real", "twin")
        for key in ("camera.rate_hz=10", "imu={type: imu, rate_hz: 100}")
    )
    sets = (*SMALLEST, *rates, recipe(tmp_path, TIMED), "record.pictures=raw")
    _, folder = fly_run(cameras=SMALL_CAMERAS, sets=sets)
    _, report = replayed(capsys, str(folder))
    combinations = {one["name"]: one for one in report["combinations"]}
    assert {name: combination["divergences"] for name, combination in combinations.items()} == {
        "camera": [],
        "imu": [],
    }
    assert not report["diverges"]
    assert all(combination["mixed"] > 10 for combination in combinations.values())


def test_images_recorded_as_jpeg_are_replayed_within_what_jpeg_loses(
    run_of: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = run_of("jpeg")
    code, report = replayed(capsys, str(folder))
    assert code == 0
    assert [one["exact"] for one in report["combinations"]] == [False, True, True, True]
    assert main(["replay", str(folder), "--trust"]) == 0
    said = capsys.readouterr().out
    assert "all as recorded, within the loss of JPEG" in said
    other = tmp_path / "other.yaml"
    other.write_text(RECIPE.replace("merge: overlay", "merge: {overlay: [real, twin]}"))
    code, report = replayed(capsys, str(folder), "--recipe", str(other))
    assert code == 1
    assert "beyond the loss of JPEG" in report["combinations"][0]["divergences"][0]["what"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("nothing",), "there is no such recording"),
        (("text.mcap",), "text.mcap"),
        (("text.mcap", "--recipe", "none.yaml"), "none.yaml"),
        (("sim.mcap",), "nothing was mixed in this run; give a --recipe"),
        (("empty.mcap",), "empty or cut at its beginning; give a --recipe"),
    ],
)
def test_a_recording_that_cannot_be_replayed_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], said: str
) -> None:
    (tmp_path / "text.mcap").write_text("none\n" * 100)
    (tmp_path / "empty.mcap").touch()
    with McapRecorder(path=tmp_path / "sim.mcap", epoch_s=0.0, clock="virtual") as run:
        run.reading("range", beam(1.0))
    given = [word if word.startswith("--") else str(tmp_path / word) for word in arguments]
    assert main(["replay", *given]) == 2
    told = capsys.readouterr()
    assert said in told.err
    assert told.out == ""


MIXED = """\
schema: wil/recipe/1
sensors: {range: {type: rangefinder}}
combine: [{sensor: range, merge: {aggregate: min}}]
"""


@pytest.fixture
def ranges(tmp_path: Path) -> Path:
    """Return the folder of a run with 40 mixtures of a rangefinder, in several chunks."""
    folder = tmp_path / "run"
    folder.mkdir()
    (tmp_path / "mixed.yaml").write_text(MIXED)
    recipe = load_recipe_file(tmp_path / "mixed.yaml")
    (mixer,) = compile_recipe(recipe, object_ids={})
    facts = {"recipe": json.dumps(recipe.document.data), "recipe_file": "mixed.yaml"}
    path = folder / "run.mcap"
    with McapRecorder(path=path, epoch_s=0.0, clock="virtual", facts=facts) as run:
        for k in range(40):
            t_s = k / 10
            stamps: dict[str, Any] = {"t_s": t_s, "arrived_s": t_s, "seq": k, "sensor": "range"}
            real = beam(3.0, "real", **stamps)
            twin = beam(2.0, **stamps)
            run.reading("range", real)
            run.reading("range", twin)
            made = mixer.mix(real, twin, now_s=t_s)
            run.mixed("range", made.reading, made.provenance, now_s=t_s)
    (folder / "log.jsonl").touch()
    return folder


def test_a_cut_in_a_recording_is_reported(ranges: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, report = replayed(capsys, str(ranges))
    assert (code, report["lacks"]) == (0, "")
    assert report["combinations"][0]["compared"] == 40
    file = ranges / "run.mcap"
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    assert main(["replay", str(ranges)]) == 3
    assert "the recording is cut after byte " in capsys.readouterr().out


@pytest.mark.parametrize("kept", [0, 100])
def test_a_recording_without_mixtures_is_not_as_recorded(
    ranges: Path, kept: int, capsys: pytest.CaptureFixture[str]
) -> None:
    file = ranges / "run.mcap"
    file.write_bytes(file.read_bytes()[:kept])
    recipe = ("--recipe", str(ranges.parent / "mixed.yaml"))
    assert main(["replay", str(ranges), *recipe]) == 3
    said = capsys.readouterr().out
    assert "the recording has no mixture to compare" in said
    assert "the recording is cut after byte " in said
    assert "all as recorded" not in said


def test_messages_that_were_dropped_in_flight_are_reported(tmp_path: Path) -> None:
    recording = Recording(tmp_path)
    recording.end = RecordStreamEnd(whole=True, read_bytes=9)
    recording.counts = {"written": "9", "failed": "0", "dropped /real/camera": "3"}
    assert recording_lack_text(recording) == "the recording lacks messages: dropped /real/camera 3"


@pytest.mark.parametrize("place", ["run", "other"])
def test_a_replay_leaves_the_folder_of_a_run_as_it_is(
    ranges: Path, place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = ranges.parent / place
    folder.mkdir(exist_ok=True)
    (folder / "log.jsonl").touch()
    (folder / "mixed.mp4").write_bytes(b"as flown")
    assert main(["replay", str(ranges), "--out", str(folder)]) == 2
    assert "is the folder of a recorded run; name another folder" in capsys.readouterr().err
    assert (folder / "mixed.mp4").read_bytes() == b"as flown"


def test_a_replay_that_is_refused_leaves_an_earlier_one(
    ranges: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (ranges / "run.mcap").write_bytes(b"")
    (tmp_path / "mixed.mp4").write_bytes(b"before")
    assert main(["replay", str(ranges), "--out", str(tmp_path)]) == 2
    assert (tmp_path / "mixed.mp4").read_bytes() == b"before"


def test_readings_are_compared_to_the_bit() -> None:
    assert difference_of_readings(beam(np.inf), beam(np.inf), exact=True) is None
    assert difference_of_readings(beam(np.nan), beam(np.nan), exact=True) is None
    found = difference_of_readings(beam(1.0), beam(1.5), exact=True)
    assert found is not None
    assert found.what == "range_m is 1.5 instead of 1.0"
    assert difference_of_readings(scan([1.0, np.inf]), scan([1.0, np.inf]), exact=True) is None
    found = difference_of_readings(
        scan([1.0, 2.0, np.inf, 4.0]), scan([1.0, 2.5, 3.0, 4.0]), exact=True
    )
    assert found is not None
    assert (found.share, found.worst) == (0.5, np.inf)
    assert found.mean == pytest.approx(1 / 6)
    found = difference_of_readings(cloud([[1, 2, 3]]), cloud([[1, 2, 3], [4, 5, 6]]), exact=True)
    assert found is not None
    assert found.what == "points_frd_m is (2, 3) instead of (1, 3)"
    image = plain()
    image[0, 0] += 1
    found = difference_of_readings(camera(), camera(image), exact=True)
    assert found is not None
    assert found.share == pytest.approx(1 / (48 * 64))
    assert difference_of_readings(camera(), camera(image), exact=False) is None
    found = difference_of_readings(camera(), replace(beam(1.0)), exact=True)
    assert found is not None
    assert found.what == "RangefinderReading instead of CameraReading"
