"""What the detectors find in pictures of boards, found once: a picture takes a while."""

import pytest

from tests.plugins.calibration.board_images import CHARUCO, CHESSBOARD, board_views
from wil_campaign.plugins.calibration.boards import BoardSighting


def _sightings(board: object) -> list[BoardSighting]:
    found = [board.find(picture) for picture in board_views(board)]  # type: ignore[attr-defined, arg-type]  # both kinds
    assert None not in found
    return [one for one in found if one is not None]


@pytest.fixture(scope="session")
def of_chessboard() -> list[BoardSighting]:
    return _sightings(CHESSBOARD)


@pytest.fixture(scope="session")
def of_charuco() -> list[BoardSighting]:
    return _sightings(CHARUCO)
