"""Boards are found where they are, to a fraction of a pixel."""

import cv2
import numpy as np
import pytest

from tests.plugins.calibration.board_images import (
    CHARUCO,
    CHESSBOARD,
    LENS,
    VIEWS,
    matrices,
    picture,
    placed,
)
from wil_campaign.plugins.calibration.boards import (
    BoardSighting,
    CalibrationError,
    CharucoBoard,
    ChessBoard,
)


def off_px(board: ChessBoard | CharucoBoard, sightings: list[BoardSighting]) -> float:
    """How far corners are found from where they are."""
    matrix, distortion = matrices(LENS)
    worst = []
    for view, sighting in zip(VIEWS, sightings, strict=True):
        rotation, position = placed(board, view)
        ahead = sighting.board_m @ rotation.T + position
        pixels = cv2.projectPoints(
            ahead.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), matrix, distortion
        )[0].reshape(-1, 2)
        worst.append(np.linalg.norm(pixels - sighting.pixels, axis=1))
    return float(np.sqrt(np.mean(np.square(np.concatenate(worst)))))


def test_corners_are_found_where_they_are(
    of_chessboard: list[BoardSighting], of_charuco: list[BoardSighting]
) -> None:
    assert off_px(CHESSBOARD, of_chessboard) < 0.3
    assert off_px(CHARUCO, of_charuco) < 0.3


def test_a_chessboard_that_is_partly_hidden_is_not_found_and_a_charuco_board_is() -> None:
    for board, found in ((CHESSBOARD, False), (CHARUCO, True)):
        image = picture(board, *placed(board, VIEWS[0]))
        image[:, :220] = 120
        assert (board.find(image) is not None) == found


def test_nothing_is_found_where_no_board_is() -> None:
    noise = np.random.default_rng(1).integers(0, 255, (240, 320, 3), np.uint8)
    assert CHESSBOARD.find(noise) is None
    assert CHARUCO.find(noise) is None
    assert CHARUCO.find(np.zeros((48, 64, 3), np.uint8)) is None


def test_an_impossible_board_is_refused() -> None:
    with pytest.raises(CalibrationError, match="3 x 3 inner corners"):
        ChessBoard(2, 6, 0.025)
    with pytest.raises(CalibrationError, match="must be smaller than its squares"):
        CharucoBoard(8, 6, 0.03, 0.03)
    with pytest.raises(CalibrationError, match=r"no dictionary '9x9_7'; choose one of 4x4_50"):
        CharucoBoard(8, 6, 0.03, 0.02, "9x9_7")
