"""Pictures of a board through a known lens, and a body that carries the camera before it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.plugins.calibration.boards import BoardSighting, CharucoBoard, ChessBoard
from wil_campaign.plugins.calibration.body_paths import BodyPath
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, quat_from_euler, rotate

Array = NDArray[np.float64]

LENS = Intrinsics(640, 480, 520.0, 515.0, 330.0, 236.0, (-0.21, 0.07, 0.0008, -0.0012))
"""A wide one: what it bends at the corners is 20 pixels."""
CHESSBOARD = ChessBoard(columns=9, rows=6, square_m=0.025)
CHARUCO = CharucoBoard(columns=8, rows=6, square_m=0.03, marker_m=0.022)
_PX_PER_SQUARE = 60
_OPTICAL_FROM_FRD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True)
class View:
    """The board's pose in the optical frame: a turn (x, y, z degrees), its middle in metres."""

    turn_deg: tuple[float, float, float]
    middle_m: tuple[float, float, float]


VIEWS = tuple(
    View((tilt_x, tilt_y, roll), (x, y, z))
    for tilt_x, tilt_y, roll, x, y, z in (
        *((0, 0, 0, 0.0, 0.0, 0.3), (35, 0, 5, 0.0, 0.02, 0.3), (-35, 0, -5, 0.0, 0.0, 0.32)),
        *((0, 38, 8, 0.0, 0.0, 0.3), (0, -38, 0, 0.02, 0.0, 0.3), (25, 25, 15, -0.05, 0, 0.35)),
        *((-25, 25, -15, 0.05, 0.0, 0.35), (20, -30, 0, -0.12, -0.08, 0.4)),
        *((-20, 30, 0, 0.12, -0.08, 0.4), (20, 30, 5, -0.12, 0.08, 0.4)),
        *((-20, -30, 0, 0.12, 0.08, 0.4), (30, 10, 20, 0.0, -0.1, 0.45)),
        *((0, -30, -20, -0.15, 0.0, 0.45), (-30, -10, 10, 0.15, 0.02, 0.45)),
        *((15, 15, 0, 0.0, 0.1, 0.42), (40, 0, 0, 0.0, 0.0, 0.6)),
    )
)


def texture(board: ChessBoard | CharucoBoard) -> tuple[NDArray[np.uint8], Array]:
    """A board's print with a white rim, and where in the board's frame its first pixel lies."""
    if isinstance(board, CharucoBoard):
        plain, first_m = board.picture(_PX_PER_SQUARE), np.zeros(2)
    else:
        cells = np.indices((board.rows + 1, board.columns + 1)).sum(axis=0) % 2 * 255
        plain = np.kron(cells, np.ones((_PX_PER_SQUARE, _PX_PER_SQUARE))).astype(np.uint8)
        first_m = np.full(2, -board.square_m)
    rim = _PX_PER_SQUARE
    bordered = cv2.copyMakeBorder(plain, rim, rim, rim, rim, cv2.BORDER_CONSTANT, value=255)
    return np.asarray(bordered, np.uint8), first_m - board.square_m


def picture(
    board: ChessBoard | CharucoBoard, rotation: Array, position_m: Array, lens: Intrinsics = LENS
) -> NDArray[np.uint8]:
    """What a camera sees of a board whose pose is given in the optical frame; grey around it."""
    printed, first_m = texture(board)
    rays = rays_of(lens) @ rotation  # in the board's axes
    eye = -rotation.T @ position_m
    along = -eye[2] / rays[:, 2]
    places = (eye + along[:, None] * rays)[:, :2]
    cells = (places - first_m) / board.square_m * _PX_PER_SQUARE - 0.5
    cells[along <= 0] = -1e4
    maps = cells.astype(np.float32).reshape(lens.height_px, lens.width_px, 2)
    size_px = _PX_PER_SQUARE * board.square_m * lens.fx_px / max(0.05, float(position_m[2]))
    blurred = cv2.GaussianBlur(printed, (0, 0), max(0.6, 0.5 * 3600 * board.square_m / size_px))
    maps_2: Any = None
    seen = cv2.remap(
        blurred, maps, maps_2, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=120.0
    )
    return np.asarray(cv2.cvtColor(seen, cv2.COLOR_GRAY2BGR), np.uint8)


@cache
def rays_of(lens: Intrinsics) -> Array:
    """The direction in which each pixel looks, optical frame."""
    matrix, distortion = matrices(lens)
    u, v = np.meshgrid(np.arange(lens.width_px, dtype=float), np.arange(lens.height_px))
    pixels = np.stack((u.ravel(), v.ravel()), axis=1).reshape(-1, 1, 2)
    rays = cv2.undistortPoints(pixels, matrix, distortion).reshape(-1, 2)
    return np.column_stack((rays, np.ones(len(rays))))


def placed(board: ChessBoard | CharucoBoard, view: View) -> tuple[Array, Array]:
    """The rotation and position of a board in the optical frame, for a view."""
    x, y, z = (math.radians(angle) for angle in view.turn_deg)
    turn = cv2.Rodrigues(np.array([0, 0, z]))[0] @ cv2.Rodrigues(np.array([x, y, 0.0]))[0]
    corners = board.corners_m if isinstance(board, ChessBoard) else np.zeros((1, 3))
    half = (
        corners.mean(axis=0)
        if isinstance(board, ChessBoard)
        else np.array([board.columns, board.rows, 0.0]) * board.square_m / 2.0
    )
    return np.asarray(turn), np.array(view.middle_m) - turn @ half


def board_views(
    board: ChessBoard | CharucoBoard, views: Sequence[View] = VIEWS
) -> list[NDArray[np.uint8]]:
    return [picture(board, *placed(board, view)) for view in views]


def matrices(lens: Intrinsics) -> tuple[Array, Array]:
    matrix = np.array([[lens.fx_px, 0, lens.cx_px], [0, lens.fy_px, lens.cy_px], [0, 0, 1.0]])
    return matrix, np.array(lens.distortion)


BOARD_POSE = Pose((1.2, 0.1, -1.0))
"""North of the body; its x axis to the east, its y axis down (see `optical`)."""


@dataclass(frozen=True)
class Hand:
    """A body that a hand turns and shifts before a board, camera on it."""

    mount: Pose
    latency_s: float
    board: Pose = BOARD_POSE
    turn_deg: float = 18.0
    sway_m: float = 0.12
    hz: float = 0.4

    def pose(self, t_s: float) -> Pose:
        """The body at a time."""
        a, turn = 2.0 * math.pi * self.hz * t_s, math.radians(self.turn_deg)
        attitude = quat_from_euler(
            turn * math.sin(1.3 * a), 0.8 * turn * math.sin(0.9 * a + 1), turn * math.sin(0.7 * a)
        )
        sway = self.sway_m
        at = (
            sway * math.sin(a),
            0.1 + sway * math.sin(0.8 * a + 2),
            -1.0 + sway * math.sin(1.1 * a + 4),
        )
        return Pose(at, attitude)

    def path(self, until_s: float, hz: float = 100.0, noise_m: float = 0.0005) -> BodyPath:
        noise = np.random.default_rng(7).normal(0.0, noise_m, (round(until_s * hz) + 1, 3))
        times = np.arange(len(noise)) / hz
        poses = [self.pose(t) for t in times]
        return BodyPath(
            times,
            np.array([pose.position_ned_m for pose in poses]) + noise,
            np.array([pose.q_wxyz for pose in poses]),
        )

    def optical(self, t_s: float) -> tuple[Array, Array]:
        """The board's rotation and position in the optical frame, `latency_s` before a stamp."""
        camera = self.pose(t_s - self.latency_s).compose(self.mount)
        # Board: x to the east, y down, z (away from who looks) to the north.
        axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        columns = [rotate(self.board.q_wxyz, tuple(axis)) for axis in axes.T]
        board_axes = np.array(columns).T
        back = camera.inverse()
        turned = np.array([rotate(back.q_wxyz, tuple(column)) for column in board_axes.T]).T
        first = np.array(back.to_parent(self.board.position_ned_m))
        return _OPTICAL_FROM_FRD @ turned, _OPTICAL_FROM_FRD @ first

    def sighting(self, t_s: float, noise: NDArray[np.float64]) -> BoardSighting | None:
        """What a detector finds at a stamp; None when a corner is out of the picture."""
        rotation, position = self.optical(t_s)
        corners = CHESSBOARD.corners_m * 2.0
        matrix, distortion = matrices(LENS)
        ahead = corners @ rotation.T + position
        if ahead[:, 2].min() < 0.1:
            return None
        pixels = cv2.projectPoints(
            ahead.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), matrix, distortion
        )[0].reshape(-1, 2)
        if pixels.min() < 0 or (pixels > (LENS.width_px, LENS.height_px)).any():
            return None
        return BoardSighting(t_s, corners, pixels + noise[: len(pixels)])

    def sightings(self, until_s: float, step_s: float = 0.15) -> list[BoardSighting]:
        random = np.random.default_rng(3)
        times = np.arange(1.0, until_s, step_s)
        found = [self.sighting(t, random.normal(0, 0.15, (54, 2))) for t in times]
        return [one for one in found if one is not None]
