"""A lens is recovered from pictures of a board: focal length to 0.3 %, what it sees to a pixel."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.plugins.calibration.board_images import LENS, matrices
from wil_campaign.plugins.calibration.boards import BoardSighting, CalibrationError
from wil_campaign.plugins.calibration.optics import (
    covered_image_share,
    fit_optics,
    most_different_sightings,
)
from wil_campaign.worlds.camera import Intrinsics

SIZE = (LENS.width_px, LENS.height_px)


def bent(lens: Intrinsics) -> np.ndarray:
    """Where rays over the whole picture are seen."""
    across, down = np.meshgrid(np.linspace(-0.55, 0.55, 12), np.linspace(-0.42, 0.42, 9))
    rays = np.stack((across.ravel(), down.ravel(), np.ones(across.size)), axis=1)
    matrix, distortion = matrices(lens)
    found = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, distortion)[0]
    return np.asarray(found).reshape(-1, 2)


@pytest.mark.parametrize("kind", ["of_chessboard", "of_charuco"])
def test_the_lens_is_recovered(kind: str, request: pytest.FixtureRequest) -> None:
    fit = fit_optics(request.getfixturevalue(kind), SIZE)
    lens = fit.intrinsics
    assert lens.fx_px == pytest.approx(LENS.fx_px, rel=0.003)
    assert lens.fy_px == pytest.approx(LENS.fy_px, rel=0.003)
    assert (lens.cx_px, lens.cy_px) == pytest.approx((LENS.cx_px, LENS.cy_px), abs=1.5)
    off_px = np.linalg.norm(bent(lens) - bent(LENS), axis=1)
    assert float(np.sqrt(np.mean(off_px**2))) < 1.0
    assert fit.rms_px < 0.3
    assert (fit.images, len(lens.distortion)) == (16, 4)
    assert fit.covered > 0.9


def test_more_coefficients_are_had_when_asked_for(of_charuco: list[BoardSighting]) -> None:
    assert len(fit_optics(of_charuco, SIZE, coefficients=5).intrinsics.distortion) == 5
    assert len(fit_optics(of_charuco, SIZE, coefficients=8).intrinsics.distortion) == 8


def test_the_error_is_that_of_all_corners_however_many_an_image_has(
    of_charuco: list[BoardSighting],
) -> None:
    few = [replace(one, board_m=one.board_m[::3], pixels=one.pixels[::3]) for one in of_charuco[:4]]
    given = [*few, *of_charuco[4:]]
    fit = fit_optics(given, SIZE)
    boards = [one.board_m.astype(np.float32) for one in given]
    pixels = [one.pixels.astype(np.float32).reshape(-1, 1, 2) for one in given]
    rms_px = cv2.calibrateCamera(boards, pixels, SIZE, None, None, flags=cv2.CALIB_FIX_K3)[0]
    assert fit.images == len(given)
    assert fit.rms_px == pytest.approx(rms_px, rel=1e-6)


def test_too_few_images_are_refused(of_charuco: list[BoardSighting]) -> None:
    with pytest.raises(CalibrationError, match="found in 5 images; 8 that differ are needed"):
        fit_optics(of_charuco[:5], SIZE)


def test_one_view_over_and_over_is_refused(of_charuco: list[BoardSighting]) -> None:
    random = np.random.default_rng(5)
    still = [
        replace(one, pixels=one.pixels + random.normal(0.0, 0.1, one.pixels.shape))
        for one in of_charuco[:2] * 30
    ]
    with pytest.raises(CalibrationError, match="60 images, and only 2 of them differ"):
        fit_optics(still, SIZE)


def test_a_board_that_is_never_tilted_is_refused(of_charuco: list[BoardSighting]) -> None:
    flat = of_charuco[0].board_m
    matrix, _ = matrices(LENS)
    sightings = []
    for k in range(12):
        place = np.array([0.03 * (k % 4) - 0.2, 0.03 * (k // 4) - 0.15, 0.4 + 0.02 * k])
        pixels = (flat + place) @ matrix.T
        sightings.append(BoardSighting(float(k), flat, pixels[:, :2] / pixels[:, 2:]))
    with pytest.raises(CalibrationError, match=r"faces the camera in all .* tilt it by 30 degrees"):
        fit_optics(sightings, SIZE)


def test_a_picture_that_was_moved_is_left_out(of_charuco: list[BoardSighting]) -> None:
    random = np.random.default_rng(5)
    spoiled = replace(
        of_charuco[3],
        pixels=of_charuco[3].pixels + random.normal(0.0, 4.0, (len(of_charuco[3].pixels), 2)),
    )
    fit = fit_optics([*of_charuco[:3], spoiled, *of_charuco[4:]], SIZE)
    assert fit.images == 15
    assert fit.rms_px < 0.3


def test_a_board_whose_print_is_bent_is_refused(of_charuco: list[BoardSighting]) -> None:
    random = np.random.default_rng(5)
    wrong = [
        replace(one, pixels=one.pixels + random.normal(0.0, 6.0, one.pixels.shape))
        for one in of_charuco
    ]
    with pytest.raises(
        CalibrationError, match=r"do not fit together: .* check that the board is flat"
    ):
        fit_optics(wrong, SIZE)


def test_the_most_different_of_many_images_are_taken(of_charuco: list[BoardSighting]) -> None:
    chosen = most_different_sightings(of_charuco * 3, SIZE, 10)
    assert len(chosen) == 10
    assert len({id(one) for one in chosen}) == 10
    assert covered_image_share(chosen, SIZE) > 0.7
    assert most_different_sightings([], SIZE, 10) == []
