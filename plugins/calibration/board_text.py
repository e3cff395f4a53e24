"""Parses the calibration boards of the command line."""

import re

from wil_campaign.plugins.calibration.boards import (
    Board,
    CalibrationError,
    CharucoBoard,
    ChessBoard,
)
from wil_campaign.plugins.offline.errors import OfflineError

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
