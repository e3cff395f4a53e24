"""Fits the optics of a camera to images of a board; pure.

Zhang's method by OpenCV (calibrateCamera), on the images that differ most.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from wil_campaign.plugins.calibration.boards import BoardSighting, CalibrationError, Points
from wil_campaign.worlds.camera import Intrinsics

FEWEST = 8
"""With fewer images of a board focal length and distortion cannot be separated."""
MOST = 40
_GRID = (8, 6)
_OUTLIER = 3.0
"""An image whose error is so many times the median is blurred by motion, or misdetected."""
_POOR_PX = 1.5
_LEAST_SLANT = 0.05
"""Least slant of the most slanted view (0: a mere scaling); a board of a fifth of the image, tilted
by 20 degrees, has it."""
_COEFFICIENTS = {
    4: cv2.CALIB_FIX_K3,
    5: 0,
    8: cv2.CALIB_RATIONAL_MODEL,
}


@dataclass(frozen=True, slots=True)
class OpticsFit:
    """The fit of a camera's optics, and how good it is.

    images: how many were used. rms_px: of their corners. covered: share of the image's cells in
    which a corner was seen.
    """

    intrinsics: Intrinsics
    images: int
    rms_px: float
    covered: float


def fit_optics(
    sightings: Sequence[BoardSighting], size: tuple[int, int], *, coefficients: int = 4
) -> OpticsFit:
    """Return the fitted optics of a camera of an image size (width, height).

    coefficients: of the distortion, 4 (k1, k2, p1, p2), 5 (with k3) or 8 (rational). Raises
    CalibrationError when the images are too few, too similar, or do not fit together.
    """
    chosen = most_different_sightings(sightings, size, MOST)
    if len(chosen) < FEWEST:
        alike = "" if len(sightings) < FEWEST else f", and only {len(chosen)} of them differ"
        raise CalibrationError(
            f"the board was found in {len(sightings)} images{alike}; {FEWEST} that differ are "
            "needed: show it near and far, in each corner, and tilted to each side"
        )
    if (slant := _slant(chosen)) < _LEAST_SLANT:
        raise CalibrationError(
            f"the board faces the camera in all {len(chosen)} images (the largest slant is "
            f"{slant:.0%}): focal length and distance cannot be separated; tilt it by 30 degrees "
            "and more, to each side"
        )
    matrix, distortion, errors = _calibrate(chosen, size, coefficients)
    kept = [
        sighting
        for sighting, e in zip(chosen, errors, strict=True)
        if e <= _OUTLIER * np.median(errors)
    ]
    if FEWEST <= len(kept) < len(chosen):
        chosen = kept
        matrix, distortion, errors = _calibrate(chosen, size, coefficients)
    counts = [len(sighting.pixels) for sighting in chosen]
    rms_px = float(np.sqrt(np.average(np.square(errors), weights=counts)))
    if not rms_px < _POOR_PX:
        raise CalibrationError(
            f"the images do not fit together: {rms_px:.1f} px off; check that the board is flat, "
            "its size right, and the camera's focus and zoom fixed"
        )
    return OpticsFit(
        intrinsics=Intrinsics(
            width_px=size[0],
            height_px=size[1],
            fx_px=float(matrix[0, 0]),
            fy_px=float(matrix[1, 1]),
            cx_px=float(matrix[0, 2]),
            cy_px=float(matrix[1, 2]),
            distortion=tuple(float(value) for value in distortion.ravel()[:coefficients]),
        ),
        images=len(chosen),
        rms_px=rms_px,
        covered=covered_image_share(chosen, size),
    )


def most_different_sightings(
    sightings: Sequence[BoardSighting], size: tuple[int, int], most: int
) -> list[BoardSighting]:
    """Return at most so many sightings, the most different ones, to fit optics.

    Of several with the same view only one is chosen: the others add no information.
    """
    if not sightings:
        return []
    views = np.array([_view(sighting, size) for sighting in sightings])
    chosen = [0]
    distances = np.linalg.norm(views - views[0], axis=1)
    while len(chosen) < min(most, len(sightings)):
        following = int(np.argmax(distances))
        if distances[following] < 0.02:
            break
        chosen.append(following)
        distances = np.minimum(distances, np.linalg.norm(views - views[following], axis=1))
    return [sightings[index] for index in sorted(chosen)]


def covered_image_share(sightings: Sequence[BoardSighting], size: tuple[int, int]) -> float:
    """Return the share of the image's cells (8 x 6) with a corner, for the optics."""
    cells = {
        (int(u * _GRID[0] / size[0]), int(v * _GRID[1] / size[1]))
        for sighting in sightings
        for u, v in sighting.pixels
    }
    return len(cells) / (_GRID[0] * _GRID[1])


def _view(one: BoardSighting, size: tuple[int, int]) -> Points:
    """Return a view of the board as a vector of middle, size and slant, to compare views."""
    board, pixels = one.board_m[:, :2], one.pixels / size[0]
    design = np.column_stack((board, np.ones(len(board))))
    affine = np.linalg.lstsq(design, pixels, rcond=None)[0]
    # The middle of the whole board, so that missing corners do not shift it.
    middle = affine[2] + affine[:2].T @ board.mean(axis=0)
    scale = float(np.ptp(board))
    return np.concatenate((middle, (scale * affine[:2]).ravel()))


def _slant(sightings: Sequence[BoardSighting]) -> float:
    """Return the slant of the most slanted view (0: none), which optics need."""
    worst = 0.0
    for sighting in sightings:
        board = sighting.board_m[:, :2]
        design = np.column_stack((board, np.ones(len(board))))
        affine = np.linalg.lstsq(design, sighting.pixels, rcond=None)[0][:2]
        long, short = np.linalg.svd(affine, compute_uv=False)
        worst = max(worst, 1.0 - float(short / long))
    return worst


def _calibrate(
    sightings: Sequence[BoardSighting], size: tuple[int, int], coefficients: int
) -> tuple[Points, Points, Points]:
    """Return fitted camera matrix, distortion, and each image's error in pixels."""
    boards = [sighting.board_m.astype(np.float32) for sighting in sightings]
    pixels = [sighting.pixels.astype(np.float32).reshape(-1, 1, 2) for sighting in sightings]
    try:
        found = cv2.calibrateCameraExtended(
            boards, pixels, size, None, None, flags=_COEFFICIENTS[coefficients]
        )
    except cv2.error as error:
        raise CalibrationError(
            f"OpenCV cannot calibrate with these images ({error.err}); take more, from other sides"
        ) from error
    return np.asarray(found[1]), np.asarray(found[2]), np.asarray(found[7]).ravel()
