"""`wil-campaign calibrate`: calibrate a real camera, and write a calibration file.

Parses the calibration boards of the command line.
"""

import asyncio
import re
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

import cv2
from cyclopts import Parameter
from pydantic import ValidationError

from wil_campaign.campaigns.schema.calibration import CalibrationPart
from wil_campaign.campaigns.schema.sources import MocapPart, SourcePart
from wil_campaign.campaigns.values.external_setups import MocapSetup
from wil_campaign.foundation.files.document_writer import require_own_file, write_atomically
from wil_campaign.foundation.files.documents import BadInput, KeyFaultError
from wil_campaign.foundation.files.problems import without_passwords
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.plugins.calibration.board_search import (
    BoardViews,
    is_recorded_run,
    search_board_in_file,
)
from wil_campaign.plugins.calibration.boards import (
    Board,
    CalibrationError,
    CharucoBoard,
    ChessBoard,
)
from wil_campaign.plugins.calibration.body_paths import BodyPath, body_path_in_csv, body_path_in_run
from wil_campaign.plugins.calibration.live_search import LiveOrder, search_live
from wil_campaign.plugins.calibration.measurement import (
    MeasurementOptions,
    calibration_yaml,
    measure_camera,
    read_optics,
)
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.plugins.offline.recorded_inputs import flown_latency_s
from wil_campaign.vehicles.errors import VehicleError

_FORMS = "chessboard:9x6:25mm (inner corners, square) or charuco:8x6:30mm:22mm[:4x4_50] (squares)"
_CHESSBOARD = re.compile(r"chessboard:(\d{1,3})x(\d{1,3}):([\d.]+)mm")
_CHARUCO = re.compile(r"charuco:(\d{1,3})x(\d{1,3}):([\d.]+)mm:([\d.]+)mm(?::(\w+))?")


def parse_board(text: str) -> Board:
    """Return the calibration board that a text names. Raises OfflineError."""
    try:
        if match := _CHESSBOARD.fullmatch(text):
            return ChessBoard(int(match[1]), int(match[2]), _metres(match[3]))
        if match := _CHARUCO.fullmatch(text):
            return CharucoBoard(
                int(match[1]),
                int(match[2]),
                _metres(match[3]),
                _metres(match[4]),
                match[5] or "4x4_50",
            )
    except (CalibrationError, ValueError) as error:
        raise OfflineError(f"--board {text}: {error}") from error
    raise OfflineError(f"--board {text}: give {_FORMS}")


def _metres(millimetres: str) -> float:
    """Return the size of a board's square in metres from millimetres. Raises ValueError."""
    metres = float(millimetres) / 1000.0
    if not 0.0 < metres < 10.0:
        raise ValueError(f"{millimetres} mm is not the size of a square")
    return metres


_LIVE = ("rtsp://", "rtsps://", "rtp://", "v4l2://", "/dev/")
_CELL_PX = 100
_WELL_COVERED = 0.6
_COEFFICIENTS = {"4": 4, "5": 5, "8": 8}


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class PoseOptions:
    """The options of `calibrate` about poses: where the camera's body was, which camera.

    Parameters
    ----------
    poses
        Poses of the camera's body during the recording: a CSV file, or the address of motion
        capture (udp://HOST:PORT). A run's folder has its own.
    poses_latency_ms
        The latency of the motion capture system, from its data sheet; for a live camera.
    body
        The body's name in motion capture.
    vehicle
        The vehicle of a run's folder whose images and poses are used.
    sensor
        The camera of a run's folder whose images are used.
    """

    poses: str | None = None
    poses_latency_ms: float | None = None
    body: str = "real"
    vehicle: Literal["real", "twin"] = "real"
    sensor: str = "camera"


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class Live:
    """The options of `calibrate` for a live camera.

    Parameters
    ----------
    size
        WIDTHxHEIGHT of a live camera's images, in pixels.
    seconds
        For how long images of a live camera are taken.
    """

    size: str | None = None
    seconds: float = 60.0


_RECORDED, _A_MINUTE = PoseOptions(), Live()


def calibrate(
    images: Annotated[str, Parameter(name=("--images", "--pictures"))] = "",
    *,
    board: str,
    out_: Annotated[Path | None, Parameter(name="--out")] = None,
    coefficients: Literal["4", "5", "8"] = "4",
    optics: Path | None = None,
    pose_options: PoseOptions = _RECORDED,
    live: Live = _A_MINUTE,
    draw: Path | None = None,
) -> int:
    """Measure a camera by a board: its optics; with poses also its mounting and its latency.

    Parameters
    ----------
    images
        A video, a folder of images, an .mcap, a run's folder, or a live camera's address.
    board
        chessboard:9x6:25mm (inner corners, square) or charuco:8x6:30mm:22mm (squares, square,
        marker; a dictionary as :4x4_50 after it).
    out_
        The calibration file to write.
    coefficients
        The number of distortion coefficients.
    optics
        A calibration file whose optics are used: only mounting and latency are measured.
    draw
        Write the ChArUco board as an image to be printed, and do nothing else.
    """
    try:
        target = parse_board(board)
        if draw is not None:
            return _draw(target, draw)
        file = _name_file(images, out_)
        require_own_file(file, rb"(#.*\s)*schema: wil/calibration/1")
        known = None if optics is None else read_optics(optics)
        views, path, flown_s = _search_images(images, target, pose_options, live)
        options = MeasurementOptions(
            board=target,
            coefficients=_COEFFICIENTS[coefficients],
            optics=known,
            flown_latency_s=flown_s,
        )
        calibration = measure_camera(views, path, options)
        write_atomically(file, calibration_yaml(calibration, made_of=images))
    except (OfflineError, BadInput) as error:
        write_stderr(error)
        return 2
    except VehicleError as error:
        shown = without_passwords(images)
        write_stderr(f"{shown}: {error}" if shown not in str(error) else error)
        return 3
    except OSError as error:
        write_stderr(f"{out_}: cannot be written: {error.strerror or error}")
        return 3
    write_stdout(_as_text(calibration, views, file))
    return 0


def _search_images(
    images: str, board: Board, where: PoseOptions, live: Live
) -> tuple[BoardViews, BodyPath | None, float | None]:
    """Return the board's views, the body's path, and the latency as flown, to calibrate."""
    poses, latency_ms = where.poses, where.poses_latency_ms
    if (poses is not None or is_recorded_run(Path(images))) and find_spec("scipy") is None:
        raise OfflineError(
            "mounting and latency need the extra calibration: "
            "pip install 'wil-campaign[calibration]'"
        )
    if not images.startswith(_LIVE) and not images.endswith(".sdp"):
        if latency_ms is not None:
            raise OfflineError(
                f"--poses-latency-ms {latency_ms:g}: is for the motion capture of a live camera; "
                "shift t_s in a CSV file instead"
            )
        return _search_recording(Path(images), board, poses, where.vehicle, where.sensor)
    mocap = None if poses is None else _mocap(poses, where.body, latency_ms or 0.0)
    order = _live(images, live.size, live.seconds, mocap)
    shown = without_passwords(images)
    write_stderr(f"taking images of {shown} for {live.seconds:g} s: move the board, or the body")
    views, path = asyncio.run(search_live(order, board))
    return views, path, 0.0


def _name_file(images: str, file: Path | None) -> Path:
    """Return the output file of `calibrate`. Raises OfflineError without one."""
    if file is None or not images:
        raise OfflineError("give images and --out FILE; or --draw FILE for a board to print")
    return file


def _search_recording(
    file: Path, board: Board, poses: str | None, vehicle: str, sensor: str
) -> tuple[BoardViews, BodyPath | None, float | None]:
    """Return a recording's board views, its body's path, and its latency as flown.

    None for the latter without a run: a video and a CSV file have clocks of their own.
    """
    path, flown_s = None if poses is None else body_path_in_csv(Path(poses)), None
    if is_recorded_run(file):
        folder = file if file.is_dir() else file.parent
        flown_s = flown_latency_s(folder, vehicle, sensor)
        path = body_path_in_run(folder, vehicle) if path is None else path
    return search_board_in_file(file, board, sensor=sensor, vehicle=vehicle), path, flown_s


def _live(address: str, size: str | None, seconds: float, mocap: MocapSetup | None) -> LiveOrder:
    """Return the live search that `calibrate` is to make. Raises OfflineError."""
    match = re.fullmatch(r"(\d{2,5})x(\d{2,5})", size or "")
    if match is None:
        raise OfflineError("a live camera needs --size WIDTHxHEIGHT, as 1280x720")
    if not 1.0 <= seconds <= 3600.0:
        raise OfflineError(f"--seconds {seconds:g}: must be between 1 and 3600")
    try:
        camera = SourcePart(address=address).setup(Path.cwd(), latency_s=0.0)
    except (ValidationError, KeyFaultError) as error:
        raise OfflineError(_reason(error)) from error
    return LiveOrder(camera=camera, size=(int(match[1]), int(match[2])), for_s=seconds, mocap=mocap)


def _mocap(address: str, body: str, latency_ms: float) -> MocapSetup:
    """Return the motion capture setup of a live `calibrate`. Raises OfflineError."""
    try:
        return MocapPart(address=address, body=body, latency_ms=latency_ms).setup("real")
    except (ValidationError, KeyFaultError) as error:
        raise OfflineError(f"--poses {address}: for a live camera {_reason(error)}") from error


def _reason(error: ValidationError | KeyFaultError) -> str:
    """Return the reason of a calibrate option's error, without pydantic's words."""
    if isinstance(error, KeyFaultError):
        return str(error)
    return error.errors()[0]["msg"].removeprefix("Value error, ")


def _draw(board: Board, path: Path) -> int:
    if not isinstance(board, CharucoBoard):
        raise OfflineError("--draw writes ChArUco boards only; chessboards are easily found")
    if path.suffix.lower() != ".png":
        raise OfflineError(f"--draw {path}: end its name with .png")
    if not cv2.imwrite(str(path), board.picture(_CELL_PX)):
        raise OfflineError(f"--draw {path}: cannot be written there")
    wide, high = (1000.0 * board.square_m * count for count in (board.columns, board.rows))
    write_stdout(
        f"{path}: print it {wide:g} mm wide and {high:g} mm high, on something flat, with a margin"
    )
    return 0


def _as_text(calibration: CalibrationPart, views: BoardViews, path: Path) -> str:
    camera, quality = calibration.camera, calibration.quality
    lines = [f"the board was seen in {len(views.sightings)} of {views.searched} images"]
    if quality is not None:
        lines.append(
            f"optics: fx {camera.fx_px:.1f}, fy {camera.fy_px:.1f}, middle {camera.cx_px:.1f}, "
            f"{camera.cy_px:.1f} px; {quality.rms_px:.2f} px off in {quality.pictures} images"
        )
        if quality.covered < _WELL_COVERED:
            lines.append(
                f"  corners were seen in only {quality.covered:.0%} of the image: elsewhere the "
                "distortion is a guess; show the board in each corner"
            )
    mount, spread = calibration.mount, calibration.spread
    if mount is not None and spread is not None:
        lines.append(
            f"mounting: forward {mount.forward_m:.3f}, right {mount.right_m:.3f}, down "
            f"{mount.down_m:.3f} m (± {spread.mount_m:.4f}); roll {mount.roll_deg:.2f}, pitch "
            f"{mount.pitch_deg:.2f}, yaw {mount.yaw_deg:.2f} degrees (± {spread.mount_deg:.3f})"
        )
        lines.append(
            "latency: not measured, since images and poses have clocks of their own; take it from "
            "a live camera with motion capture, or from a run's recording"
            if calibration.latency_ms is None
            else f"latency: {calibration.latency_ms:.1f} ms (± {spread.latency_ms:.2f}), middle of "
            "the exposure to arrival"
        )
    return "\n".join([*lines, f"written to {path}; name it as a camera's `calibration`"])
