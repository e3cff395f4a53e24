"""`wil-campaign calibrate`: from pictures of a board to a file that campaigns name."""

import csv
import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.plugins.calibration.board_images import CHARUCO, LENS, Hand, board_views, picture
from tests.ports import free_port
from wil_campaign.campaigns.schema.calibration import CalibrationPart, read_calibration
from wil_campaign.foundation.files.documents import load_document
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.recording.judge_log_file import JudgeLogWriter
from wil_campaign.orchestrator.recording.mcap.mcap_writer import McapRecorder
from wil_campaign.orchestrator.recording.timestamps import VIRTUAL_EPOCH_S
from wil_campaign.plugins.calibration.boards import CharucoBoard
from wil_campaign.plugins.calibration.body_paths import body_path_in_csv
from wil_campaign.plugins.calibration.measurement import calibration_yaml
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.worlds.frames import Pose, quat_from_euler

BOARD = "charuco:8x6:30mm:22mm"
LARGE, LARGE_BOARD = CharucoBoard(8, 6, 0.12, 0.09), "charuco:8x6:120mm:90mm"
HAND = Hand(Pose((0.1, -0.02, 0.05), quat_from_euler(0.05, -0.1, 0.2)), 0.085)
BOARD_AT = Pose((1.4, -0.35, -1.3))
UNTIL_S, STEP_S = 7.0, 0.2

Images = list[NDArray[np.uint8]]


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Images of a board from many sides."""
    return written(tmp_path_factory.mktemp("views"), board_views(CHARUCO))


@pytest.fixture(scope="module")
def moving() -> Images:
    """What a camera in a hand sees, each STEP_S from 0 on."""
    hand = Hand(HAND.mount, HAND.latency_s, BOARD_AT)
    return [picture(LARGE, *hand.optical(k * STEP_S)) for k in range(round(UNTIL_S / STEP_S))]


@pytest.fixture
def optics(tmp_path: Path) -> Path:
    camera = {key: getattr(LENS, key) for key in ("width_px", "height_px", "fx_px", "fy_px")}
    camera |= {"cx_px": LENS.cx_px, "cy_px": LENS.cy_px, "distortion": list(LENS.distortion)}
    part = CalibrationPart.model_validate({"schema": "wil/calibration/1", "camera": camera})
    (tmp_path / "optics.yaml").write_text(calibration_yaml(part, made_of="nothing"))
    return tmp_path / "optics.yaml"


def written(folder: Path, images: Images) -> Path:
    for number, image in enumerate(images):
        cv2.imwrite(str(folder / f"{number}.png"), image)
    return folder


def video(path: Path, images: Images, hz: float = 1.0 / STEP_S) -> Path:
    size = (images[0].shape[1], images[0].shape[0])
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), hz, size)
    for image in images:
        writer.write(image)
    writer.release()
    return path


def poses_csv(path: Path, hz: float = 100.0, zero_s: float = 0.0) -> Path:
    with path.open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(["t_s", "note", "north_m", "east_m", "down_m", "qw", "qx", "qy", "qz"])
        for k in range(-100, round(UNTIL_S * hz)):
            pose = HAND.pose(k / hz)
            rows.writerow([zero_s + k / hz, "x", *pose.position_ned_m, *pose.q_wxyz])
    return path


def read(path: Path) -> CalibrationPart:
    return read_calibration(load_document(path, name=str(path)))


def check_mounting(found: CalibrationPart) -> None:
    assert found.mount is not None
    mount, spread = found.mount, found.spread
    at = (mount.forward_m, mount.right_m, mount.down_m)
    assert at == pytest.approx(HAND.mount.position_ned_m, abs=0.01)
    angles = (mount.roll_deg, mount.pitch_deg, mount.yaw_deg)
    assert angles == pytest.approx(np.degrees((0.05, -0.1, 0.2)), abs=0.3)
    assert spread is not None
    if found.latency_ms is not None:
        assert (spread.latency_ms or 9.9) < 2.0


def test_optics_of_a_folder_of_images(
    views: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "camera.yaml"
    assert main(["calibrate", str(views), "--board", BOARD, "--out", str(out)]) == 0
    found = read(out)
    assert found.camera.fx_px == pytest.approx(LENS.fx_px, rel=0.003)
    assert (found.camera.width_px, len(found.camera.distortion)) == (640, 4)
    assert found.quality is not None
    assert found.quality.board == "ChArUco 8x6, 30 mm, markers 22 mm, 4x4_50"
    assert (found.mount, found.latency_ms) == (None, None)
    said = capsys.readouterr().out
    assert "the board was seen in 16 of 16 images" in said
    assert f"written to {out}; name it as a camera's `calibration`" in said
    assert out.read_text().startswith(f"# Written by wil-campaign calibrate, from {views}\n")


@pytest.mark.parametrize("zero_s", [0.0, 0.2])
def test_mounting_by_a_video_and_the_poses_of_its_body_whose_clocks_differ(
    moving: Images,
    optics: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    zero_s: float,
) -> None:
    film = video(tmp_path / "hand.mp4", moving)
    poses = poses_csv(tmp_path / "poses.csv", zero_s=zero_s)
    out = tmp_path / "camera.yaml"
    given = ["--board", LARGE_BOARD, "--out", str(out), "--optics", str(optics)]
    assert main(["calibrate", str(film), *given, "--poses", str(poses)]) == 0
    found = read(out)
    check_mounting(found)
    assert found.latency_ms is None
    assert found.camera == read(optics).camera
    said = capsys.readouterr().out
    assert "latency: not measured, since images and poses have clocks of their own" in said


def test_a_latency_of_motion_capture_is_for_a_live_camera(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--board", LARGE_BOARD, "--out", str(tmp_path / "camera.yaml")]
    given += ["--poses", "poses.csv", "--poses-latency-ms", "20"]
    assert main(["calibrate", "hand.mp4", *given]) == 2
    assert "--poses-latency-ms 20: is for the motion capture" in capsys.readouterr().err


@pytest.mark.parametrize("has_csv", [False, True])
def test_a_recorded_run_has_images_and_poses(
    moving: Images, optics: Path, tmp_path: Path, *, has_csv: bool
) -> None:
    run = tmp_path / "run"
    run.mkdir()
    facts = {"latency_s": json.dumps({"real camera": 0.03})}
    with McapRecorder(
        path=run / "run.mcap", epoch_s=VIRTUAL_EPOCH_S, clock="virtual", facts=facts
    ) as recorder:
        for k, image in enumerate(moving):
            t_s = 1.0 + k * STEP_S - 0.03  # 30 ms were taken off already
            recorder.reading("camera", CameraReading(t_s, t_s, k, "real", image, LENS))
    with JudgeLogWriter(path=run / "judged.msgpack") as tape:
        for k in range(round(UNTIL_S * 50)):
            for name in ("real", "twin"):
                pose = HAND.pose(k / 50 - (1.0 if name == "real" else 3.0))
                tape.write(PoseSample(k / 50, name, pose, (0.0, 0.0, 0.0)))
    out = tmp_path / "camera.yaml"
    given = ["--board", LARGE_BOARD, "--out", str(out), "--optics", str(optics)]
    if has_csv:
        given += ["--poses", str(poses_csv(tmp_path / "poses.csv", zero_s=1.0))]
    assert main(["calibrate", str(run), *given]) == 0
    found = read(out)
    check_mounting(found)
    assert found.latency_ms == pytest.approx(85.0, abs=3.0)


def test_a_recorded_run_without_such_a_camera_names_those_that_it_has(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    run.mkdir()
    with McapRecorder(path=run / "run.mcap", epoch_s=VIRTUAL_EPOCH_S, clock="virtual") as recorder:
        grey = np.full((480, 640, 3), 90, np.uint8)
        recorder.reading("front", CameraReading(0.0, 0.0, 0, "real", grey, LENS))
    with JudgeLogWriter(path=run / "judged.msgpack"):
        pass
    given = ["--board", BOARD, "--out", str(tmp_path / "c.yaml"), "--sensor", "fornt"]
    assert main(["calibrate", str(run), *given]) == 2
    assert "has no images of 'real fornt' (it has: real front)" in capsys.readouterr().err


GREY = [np.full((480, 640, 3), 90, np.uint8)] * 12


@pytest.mark.parametrize(
    ("images", "said"),
    [
        (GREY, "was found in none of 12 images: count a chessboard's inner corners"),
        (lambda views: views[:5], "found in 5 images; 8 that differ are needed"),
        (lambda views: views[:1] * 20, "20 images, and only 1 of them differ"),
        (lambda views: [*views[:9], views[9][:240]], "image 10 has 640x240, those before it"),
    ],
)
def test_images_that_show_too_little(
    images: object,
    said: str,
    views: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    seen = [cv2.imread(str(views / f"{k}.png")) for k in range(16)]
    folder = tmp_path / "images"
    folder.mkdir()
    written(folder, images(seen) if callable(images) else images)  # type: ignore[arg-type]  # as above
    out = tmp_path / "c.yaml"
    assert main(["calibrate", str(folder), "--board", BOARD, "--out", str(out)]) == 3
    assert said in capsys.readouterr().err
    assert not out.exists()


def test_files_and_options_that_cannot_be_used(
    views: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = tmp_path / "bad.mp4"
    bad.write_text("no video")
    for name, text in (
        ("columns.csv", "t_s,north_m\n1,2\n"),
        ("number.csv", "t_s,north_m,east_m,down_m,qw,qx,qy,qz\n0,0,0,0,1,0,0,zero\n"),
        ("turn.csv", "t_s,north_m,east_m,down_m,qw,qx,qy,qz\n0,0,0,0,0,0,0,0\n"),
        ("opt.yaml", "schema: wil/calibration/1\ncamera: {width_px: 640}\n"),
    ):
        (tmp_path / name).write_text(text)
    board, out = ["--board", BOARD], ["--out", str(tmp_path / "c.yaml")]
    for given, said in (
        (["calibrate", str(tmp_path / "none.mp4"), *board, *out], "there is no such file"),
        (["calibrate", str(bad), *board, *out], "bad.mp4"),
        (["calibrate", *board], "give images and --out FILE"),
        (["calibrate", str(views), *out, "--board", "chess:9x6"], "give chessboard:9x6:25mm"),
        (["calibrate", str(views), *out, "--board", "chessboard:2x6:25mm"], "at least 3 x 3"),
        (
            ["calibrate", str(views), *out, "--board", "chessboard:9x6:0mm"],
            "not the size of a square",
        ),
        (
            ["calibrate", str(views), *board, *out, "--poses", str(tmp_path / "columns.csv")],
            "columns.csv:1: has no column east_m, down_m",
        ),
        (
            ["calibrate", str(views), *board, *out, "--poses", str(tmp_path / "number.csv")],
            "number.csv:2: could not convert string to float: 'zero'",
        ),
        (
            ["calibrate", str(views), *board, *out, "--poses", str(tmp_path / "turn.csv")],
            "turn.csv:2: is not a pose",
        ),
        (
            ["calibrate", str(views), *board, *out, "--optics", str(tmp_path / "opt.yaml")],
            "opt.yaml:2:",
        ),
        (["calibrate", "/dev/video7", *board, *out], "needs --size WIDTHxHEIGHT"),
        (
            ["calibrate", "/dev/video7", *board, *out, "--size", "640x480", "--poses", "nowhere"],
            "must be udp://HOST:PORT",
        ),
        (
            ["calibrate", "/dev/video7", *board, *out, "--size", "640x480", "--poses", "vrpn://h"],
            "for a live camera VRPN is not read any more",
        ),
        (["calibrate", "rtp://h", *board, *out, "--size", "640x480"], "is not rtp://HOST:PORT"),
        (["calibrate", "--board", "chessboard:9x6:25mm", "--draw", "b.png"], "ChArUco boards only"),
        (["calibrate", "--board", BOARD, "--draw", "b.txt"], "end its name with .png"),
    ):
        assert main(given) == 2, given
        assert said in capsys.readouterr().err, given
    assert not (tmp_path / "c.yaml").exists()


def test_poses_without_the_extra_are_refused_before_the_search_for_boards(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "scipy", None)
    given = ["--board", BOARD, "--out", str(tmp_path / "c.yaml"), "--poses", "udp://127.0.0.1:5570"]
    assert main(["calibrate", "/dev/video97", *given, "--size", "640x480"]) == 2
    assert "pip install 'wil-campaign[calibration]'" in capsys.readouterr().err


def test_a_camera_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--board", BOARD, "--out", str(tmp_path / "c.yaml"), "--size", "640x480"]
    assert main(["calibrate", "/dev/video97", *given]) == 3
    assert "/dev/video97" in capsys.readouterr().err


def test_optics_of_another_size_are_refused(
    optics: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], views: Path
) -> None:
    views_bgr = [cv2.imread(str(views / f"{k}.png")) for k in range(9)]
    small = [view[::2, ::2] for view in views_bgr if view is not None]
    folder = tmp_path / "small"
    folder.mkdir()
    written(folder, small)
    given = ["--board", BOARD, "--out", str(tmp_path / "c.yaml"), "--optics", str(optics)]
    assert main(["calibrate", str(folder), *given]) == 3
    assert "images have 320x240, but the optics are for 640x480" in capsys.readouterr().err


def test_the_board_that_is_drawn_is_the_one_that_is_found(tmp_path: Path) -> None:
    path = tmp_path / "board.png"
    assert main(["calibrate", "--board", BOARD, "--draw", str(path)]) == 0
    drawn = cv2.copyMakeBorder(cv2.imread(str(path)), 50, 50, 50, 50, cv2.BORDER_REPLICATE)
    found = CHARUCO.find(np.asarray(drawn, np.uint8))
    assert found is not None
    assert len(found.pixels) == 35


def test_poses_of_a_spreadsheet_begin_with_a_mark_of_their_encoding(tmp_path: Path) -> None:
    path = poses_csv(tmp_path / "poses.csv")
    plain = body_path_in_csv(path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert body_path_in_csv(path).t_s.tolist() == plain.t_s.tolist()


def test_poses_of_a_device_are_refused(tmp_path: Path) -> None:
    """It may have no end: /dev/zero was read for ever."""
    (tmp_path / "poses.csv").symlink_to("/dev/null")
    with pytest.raises(OfflineError, match="is not a file"):
        body_path_in_csv(tmp_path / "poses.csv")


def test_the_password_of_a_camera_is_in_no_calibration(
    optics: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It stood in the file's first line, and in what is printed."""
    part = read_calibration(load_document(optics))
    text = calibration_yaml(part, made_of="rtsp://bob:s3cr3t@cam/main")
    assert text.splitlines()[0].endswith("calibrate, from rtsp://bob:***@cam/main")
    address = f"rtsp://bob:s3cr3t@127.0.0.1:{free_port()}/main"
    options = ["--board", BOARD, "--size", "640x480", "--seconds", "1"]
    assert main(["calibrate", address, *options, "--out", str(tmp_path / "camera.yaml")]) == 3
    printed = "".join(capsys.readouterr())
    assert "rtsp://bob:***@127.0.0.1" in printed
    assert "s3cr3t" not in printed
