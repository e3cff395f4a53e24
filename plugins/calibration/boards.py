"""Calibration boards (chessboard, ChArUco), and their detection in images; pure."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.errors import VehicleError

Picture = NDArray[np.uint8]
Points = NDArray[np.float64]

_FEWEST_CHARUCO = 8
"""Least corners of a ChArUco board in an image: fewer hardly constrain the optics."""
DICTIONARIES = {
    f"{bits}x{bits}_{count}": getattr(cv2.aruco, f"DICT_{bits}X{bits}_{count}")
    for bits in (4, 5, 6, 7)
    for count in (50, 100, 250, 1000)
}


class CalibrationError(VehicleError):
    """A camera cannot be calibrated with a board; says why and what to do."""


@dataclass(frozen=True, slots=True)
class BoardSighting:
    """A sighting of a calibration board in an image.

    t_s: when the image was taken, by its stamp. board_m: (n, 3), corners in the board's frame,
    z 0. pixels: (n, 2), where they are seen.
    """

    t_s: float
    board_m: Points
    pixels: Points


class Board(Protocol):
    """A flat calibration board with corners at known places."""

    @property
    def name(self) -> str:
        """Return the calibration board's name in messages."""

    def find(self, image_bgr: Picture, t_s: float = 0.0) -> BoardSighting | None:
        """Return the board's corners in an image; None when they are not seen."""


@dataclass(frozen=True)
class ChessBoard:
    """A chessboard to calibrate with, visible as a whole. columns, rows: of inner corners.

    It looks the same upside down: hold it upright, within a quarter turn.
    """

    columns: int
    rows: int
    square_m: float

    def __post_init__(self) -> None:
        """Refuse a chessboard that no detector finds."""
        if min(self.columns, self.rows) < 3:
            raise CalibrationError("a chessboard needs at least 3 x 3 inner corners")

    @property
    def name(self) -> str:
        """Return the chessboard's kind and size."""
        return f"chessboard {self.columns}x{self.rows}, {1000 * self.square_m:g} mm"

    @cached_property
    def corners_m(self) -> Points:
        """Return the chessboard's corners, row by row."""
        across, down = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        flat = np.stack((across.ravel(), down.ravel(), np.zeros(across.size)), axis=1)
        return np.asarray(flat * self.square_m, np.float64)

    def find(self, image_bgr: Picture, t_s: float = 0.0) -> BoardSighting | None:
        """Return all corners of the chessboard in an image; None when one is missing."""
        gray = _gray(image_bgr)
        size = (self.columns, self.rows)
        flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
        found, corners = cv2.findChessboardCornersSB(gray, size, flags=flags)
        if not found:
            return None
        pixels = corners.reshape(-1, 2).astype(np.float64)
        if self._is_upside_down(pixels):
            pixels = pixels[::-1]
        return BoardSighting(t_s, self.corners_m, pixels.copy())

    def _is_upside_down(self, pixels: Points) -> bool:
        across = pixels[self.columns - 1] - pixels[0]
        return float(across[0]) < 0.0


@dataclass(frozen=True)
class CharucoBoard:
    """A chessboard with markers, which may be visible in part. columns, rows: of squares."""

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str = "4x4_50"

    def __post_init__(self) -> None:
        """Refuse an impossible ChArUco board."""
        if self.dictionary not in DICTIONARIES:
            raise CalibrationError(
                f"there is no dictionary '{self.dictionary}'; choose one of "
                f"{', '.join(DICTIONARIES)}"
            )
        if not 0.0 < self.marker_m < self.square_m:
            raise CalibrationError(
                "the markers of a ChArUco board must be smaller than its squares, and larger than 0"
            )
        if min(self.columns, self.rows) < 3:
            raise CalibrationError("a ChArUco board needs at least 3 x 3 squares")

    @property
    def name(self) -> str:
        """Return the ChArUco board's kind and size."""
        return (
            f"ChArUco {self.columns}x{self.rows}, {1000 * self.square_m:g} mm, markers "
            f"{1000 * self.marker_m:g} mm, {self.dictionary}"
        )

    @cached_property
    def _board(self) -> Any:
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARIES[self.dictionary])
        size = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(size, self.square_m, self.marker_m, dictionary)

    @cached_property
    def _detector(self) -> Any:
        return cv2.aruco.CharucoDetector(self._board)

    def picture(self, pixels_per_square: int) -> Picture:
        """Return the ChArUco board's image to be printed."""
        size = (self.columns * pixels_per_square, self.rows * pixels_per_square)
        return np.asarray(self._board.generateImage(size), np.uint8)

    def find(self, image_bgr: Picture, t_s: float = 0.0) -> BoardSighting | None:
        """Return the board's corners seen in an image; None when too few."""
        corners, ids, _, _ = self._detector.detectBoard(_gray(image_bgr))
        if ids is None or len(ids) < _FEWEST_CHARUCO:
            return None
        numbers = np.asarray(ids).ravel()
        places = np.asarray(self._board.getChessboardCorners(), np.float64)[numbers]
        if np.linalg.matrix_rank(places - places[0], tol=0.1 * self.square_m) < 2:
            return None  # Corners in one line span no plane.
        return BoardSighting(t_s, places, np.asarray(corners, np.float64).reshape(-1, 2))


def _gray(image_bgr: Picture) -> Picture:
    """Return an image in grey levels, to find a board in it."""
    if image_bgr.ndim == 2:
        return image_bgr
    return np.asarray(cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY), np.uint8)
