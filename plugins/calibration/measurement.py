"""Measures a camera's calibration from views of a board."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from wil_campaign.campaigns.schema.calibration import (
    CalibrationPart,
    OpticsPart,
    OpticsQualityPart,
    SpreadPart,
    read_calibration,
)
from wil_campaign.foundation.files.documents import load_document
from wil_campaign.foundation.files.paths import is_file
from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.plugins.calibration.board_search import BoardViews
from wil_campaign.plugins.calibration.boards import Board, CalibrationError
from wil_campaign.plugins.calibration.body_paths import BodyPath
from wil_campaign.plugins.calibration.optics import OpticsFit, fit_optics
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.vehicles.sensors.sensor_spec import MountPart
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, euler_from_quat

if TYPE_CHECKING:
    from wil_campaign.plugins.calibration.mounting import MountingFit

_THRICE = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasurementOptions:
    """Options of a measurement. optics: from an earlier one, to keep; None to measure them.

    flown_latency_s: the latency that was already subtracted from the images' stamps; None where
    images and poses have clocks of their own, whose offset is no latency of the camera.
    """

    board: Board
    coefficients: int = 4
    optics: CalibrationPart | None = None
    flown_latency_s: float | None = 0.0


def measure_camera(
    seen: BoardViews, path: BodyPath | None, how: MeasurementOptions
) -> CalibrationPart:
    """Return the measured calibration; mount and latency only with a path.

    No latency where images and poses have clocks of their own.
    """
    given = how.optics
    if given is None:
        fit = fit_optics(seen.sightings, seen.size, coefficients=how.coefficients)
        camera = _optics(fit.intrinsics)
        quality: OpticsQualityPart | None = _quality(fit, how.board)
    else:
        camera, quality = given.camera, given.quality
        if (camera.width_px, camera.height_px) != seen.size:
            raise CalibrationError(
                f"the images have {seen.size[0]}x{seen.size[1]}, but the optics are for "
                f"{camera.width_px}x{camera.height_px}"
            )
    found = CalibrationPart(
        schema="wil/calibration/1",
        camera=camera,
        quality=quality,
        mount=None,
        latency_ms=None,
        spread=None,
    )
    if path is None:
        return found
    # SciPy, of an extra.
    from wil_campaign.plugins.calibration.mounting import fit_mounting  # noqa: PLC0415

    mounting = fit_mounting(seen.sightings, path, camera.intrinsics())
    flown_s = how.flown_latency_s
    return found.model_copy(
        update={
            "mount": _mount(mounting.mount),
            "latency_ms": None if flown_s is None else _latency_ms(mounting, flown_s),
            "spread": SpreadPart(
                mount_m=round(mounting.spread_m, 5),
                mount_deg=round(math.degrees(mounting.spread_rad), 4),
                latency_ms=None if flown_s is None else round(1000.0 * mounting.spread_s, 3),
            ),
        }
    )


def read_optics(path: Path) -> CalibrationPart:
    """Return the optics in a calibration file. Raises BadInput, OfflineError."""
    if not is_file(path):
        raise OfflineError(f"{path}: there is no such file")
    return read_calibration(load_document(path, name=str(path)))


def calibration_yaml(calibration: CalibrationPart, *, made_of: str) -> str:
    """Return the measured calibration as a YAML file. made_of: what it was measured from."""
    plain: dict[str, Any] = calibration.model_dump(by_alias=True, exclude_none=True)
    body = yaml.safe_dump(plain, sort_keys=False, default_flow_style=None, width=100)
    return f"# Written by wil-campaign calibrate, from {printable_problem(made_of)}\n{body}"


def _latency_ms(fit: "MountingFit", flown_s: float) -> float:
    """Return the measured latency of a camera. Raises CalibrationError when negative."""
    latency_s = fit.latency_s + flown_s
    if latency_s < -_THRICE * fit.spread_s - 1e-3:
        raise CalibrationError(
            f"the images are {-1000 * latency_s:.0f} ms ahead of the poses: the poses have more "
            "latency; give it by --poses-latency-ms, or check that both use one clock"
        )
    return round(max(0.0, 1000.0 * latency_s), 2)


def _optics(camera: Intrinsics) -> OpticsPart:
    """Return the measured camera model as the optics part of a calibration file."""
    return OpticsPart(
        width_px=camera.width_px,
        height_px=camera.height_px,
        fx_px=round(camera.fx_px, 4),
        fy_px=round(camera.fy_px, 4),
        cx_px=round(camera.cx_px, 4),
        cy_px=round(camera.cy_px, 4),
        distortion=[round(value, 8) for value in camera.distortion],
    )


def _quality(fit: OpticsFit, board: Board) -> OpticsQualityPart:
    return OpticsQualityPart(
        board=board.name,
        pictures=fit.images,
        rms_px=round(fit.rms_px, 4),
        covered=round(fit.covered, 3),
    )


def _mount(pose: Pose) -> MountPart:
    forward, right, down = (round(value, 5) for value in pose.position_ned_m)
    roll, pitch, yaw = (round(math.degrees(angle), 4) for angle in euler_from_quat(pose.q_wxyz))
    return MountPart(
        forward_m=forward, right_m=right, down_m=down, roll_deg=roll, pitch_deg=pitch, yaw_deg=yaw
    )
