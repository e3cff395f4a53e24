"""Fits mounting and latency of a camera on a body that moves in front of a fixed board; pure.

Unknown are the camera's pose on the body, the board's pose in the world, and the latency of the
images. A camera at the body's pose one latency before an image's stamp has to see the board's
corners where the real one did: all unknowns are fitted together, by least squares over all corners.
The start is the closed form of Park and Martin, "Robot sensor calibration: solving AX = XB on the
Euclidean group", 1994.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation, Slerp

from wil_campaign.plugins.calibration.boards import BoardSighting, CalibrationError, Points
from wil_campaign.plugins.calibration.body_paths import BodyPath
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

FEWEST = 12
LONGEST_S = 0.5
"""The largest latency that is tried."""
_STEP_S = 0.02
_OPTICAL_FROM_FRD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
_LEAST_TURN_RAD = np.radians(10.0)
_LEAST_OF_TWO = 0.2
_SPACED = 40
"""Images whose pairs are used for the closed form."""
_POOR_PX = 5.0
_MOST = 100
_GAP_S, _GAP_STEPS = 0.1, 5.0
"""Between two poses that are farther apart, as of a body that was hidden, it is not known."""
_FARTHEST_PX = 1e4
_DIFFERENCE = 1e-6
"""Step of finite differences (m, rad, s): far below the wanted accuracy, far above rounding."""


@dataclass(frozen=True, slots=True)
class MountingFit:
    """The fit of a camera's mounting and latency, and how well both are known.

    mount: the camera's pose (FRD axes) on the body. latency_s: middle of the exposure to the
    stamp. spread_*: one standard deviation. rms_px: of all corners.
    """

    mount: Pose
    latency_s: float
    board: Pose
    images: int
    rms_px: float
    spread_m: float
    spread_rad: float
    spread_s: float


def fit_mounting(
    sightings: Sequence[BoardSighting], path: BodyPath, intrinsics: Intrinsics
) -> MountingFit:
    """Return the fit of mounting and latency. sightings: stamped on the path's clock.

    Raises CalibrationError when there are too few images, or the body did not move enough.
    """
    track = _Track(path)
    seen = [
        sighting for sighting in sightings if track.covers(sighting.t_s - LONGEST_S, sighting.t_s)
    ]
    seen = seen[:: -(-len(seen) // _MOST) or 1]
    if len(seen) < FEWEST:
        raise CalibrationError(
            f"{len(seen)} images show the board while the body's pose is known; {FEWEST} are "
            "needed: move slowly for half a minute, with the board in view"
        )
    boards = [_board_from_camera(one, intrinsics) for one in seen]
    times = np.array([one.t_s for one in seen])
    starts = [_closed_form(track, times - late_s, boards) for late_s in _latencies()]
    late_s, (mount, board, _) = min(
        zip(_latencies(), starts, strict=True), key=lambda start: start[1][2]
    )
    problem = _Problem(seen, times, track, intrinsics)
    guess = np.concatenate((_parameters_of(mount), _parameters_of(board), [late_s]))
    found: Any = least_squares(
        problem.residuals,
        guess,
        jac=problem.jacobian,
        loss="soft_l1",
        x_scale=np.array([0.1] * 3 + [0.05] * 3 + [0.1] * 3 + [0.05] * 3 + [0.05]),
        max_nfev=100,
    )
    return _check_fit(found, problem, len(seen))


def _latencies() -> Points:
    """Return the camera latencies that the mounting fit tries."""
    return np.arange(0.0, LONGEST_S, _STEP_S, dtype=np.float64)


def _check_fit(found: Any, problem: "_Problem", images: int) -> MountingFit:
    plain = problem.residuals(found.x)
    rms_px = float(np.sqrt(2.0 * np.mean(np.square(plain))))
    if not rms_px < _POOR_PX:
        raise CalibrationError(
            f"the camera's images and the body's poses do not fit: {rms_px:.1f} px off; check that "
            "the board did not move, and that pose and image are of the same body"
        )
    information = found.jac.T @ found.jac
    variance = float(np.sum(np.square(plain))) / max(1, len(plain) - len(found.x))
    try:
        spread = np.sqrt(np.diag(np.linalg.inv(information)) * variance)
    except np.linalg.LinAlgError:
        spread = np.full(len(found.x), np.inf)
    fit = MountingFit(
        mount=_pose_of(found.x[:6]),
        latency_s=float(found.x[12]),
        board=_pose_of(found.x[6:12]),
        images=images,
        rms_px=rms_px,
        spread_m=float(np.max(spread[:3])),
        spread_rad=float(np.max(spread[3:6])),
        spread_s=float(spread[12]),
    )
    if not fit.spread_rad < np.radians(2.0) or not fit.spread_m < 0.05:
        raise CalibrationError(_move_more(f"± {fit.spread_m:.2f} m"))
    if not fit.spread_s < 0.02:
        raise CalibrationError(
            f"the latency cannot be determined (± {1000 * fit.spread_s:.0f} ms): move "
            "it back and forth faster"
        )
    return fit


def _move_more(known: str) -> str:
    """Return the message that the mounting needs more motion of the body."""
    return (
        f"the mounting cannot be determined ({known}): turn the body by 20 degrees and "
        "more about two axes at least (pitch, yaw, roll), with the board in view"
    )


class _Track:
    """A body's path, interpolated at any time for the mounting fit."""

    def __init__(self, path: BodyPath) -> None:
        order = np.argsort(path.t_s, kind="stable")
        times = path.t_s[order]
        fresh = np.concatenate(([True], np.diff(times) > 0.0))
        self._t_s = times[fresh]
        if len(self._t_s) < 2:
            raise CalibrationError("the body's pose is not known: no poses arrived")
        steps_s = np.diff(self._t_s)
        gaps = steps_s > max(_GAP_S, _GAP_STEPS * float(np.median(steps_s)))
        self._gaps_s = np.stack((self._t_s[:-1][gaps], self._t_s[1:][gaps]), axis=1)
        self._positions = path.position_ned_m[order][fresh]
        q = path.q_wxyz[order][fresh]
        self._slerp = Slerp(self._t_s, Rotation.from_quat(q[:, [1, 2, 3, 0]]))

    def covers(self, from_s: float, to_s: float) -> bool:
        """Return whether the body's track covers a time span, without a gap in it."""
        in_gap = (self._gaps_s[:, 0] < to_s) & (from_s < self._gaps_s[:, 1])
        return bool(self._t_s[0] <= from_s and to_s <= self._t_s[-1] and not in_gap.any())

    def at(self, times_s: Points) -> tuple[Points, Points]:
        """Return the body's rotations (n, 3, 3) to world, and positions (n, 3)."""
        within = np.clip(times_s, self._t_s[0], self._t_s[-1])
        columns = [np.interp(within, self._t_s, self._positions[:, axis]) for axis in range(3)]
        return np.asarray(self._slerp(within).as_matrix()), np.stack(columns, axis=1)


class _Problem:
    """The least-squares problem of the mounting: corners as predicted less as seen."""

    def __init__(
        self, seen: Sequence[BoardSighting], times: Points, track: _Track, intrinsics: Intrinsics
    ) -> None:
        self._times = times
        self._track = track
        self._matrix, self._distortion = _lens(intrinsics)
        # All corners of all images in one array, and the index of each corner's image.
        self._board_m = np.concatenate([sighting.board_m for sighting in seen])
        self._pixels = np.concatenate([sighting.pixels for sighting in seen])
        self._of = np.repeat(np.arange(len(seen)), [len(sighting.board_m) for sighting in seen])

    def residuals(self, x: Points) -> Points:
        """Return the residuals of a mounting: pixels of all corners."""
        mount_r, mount_t = _turn(x[3:6]), x[:3]
        world = self._board_m @ _turn(x[9:12]).T + x[6:9]
        rotations, positions = self._track.at(self._times - x[12])
        on_body = np.einsum("ni,nij->nj", world - positions[self._of], rotations[self._of])
        optical = (on_body - mount_t) @ mount_r @ _OPTICAL_FROM_FRD.T
        # Corners behind the camera are moved in front of it, so that they project far off.
        optical[:, 2] = np.maximum(optical[:, 2], 1e-3)
        pixels = cv2.projectPoints(
            optical.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), self._matrix, self._distortion
        )[0].reshape(-1, 2)
        off = np.clip((pixels - self._pixels).ravel(), -_FARTHEST_PX, _FARTHEST_PX)
        return np.asarray(off)

    def jacobian(self, x: Points) -> Points:
        """Return the Jacobian of the mounting's residuals by finite differences."""
        steps = _DIFFERENCE * np.eye(len(x))
        columns = [self.residuals(x + step) - self.residuals(x - step) for step in steps]
        return np.stack(columns, axis=1) / (2.0 * _DIFFERENCE)


def _board_from_camera(one: BoardSighting, intrinsics: Intrinsics) -> tuple[Points, Points]:
    """Return rotation and position of the board in the camera's FRD frame."""
    matrix, distortion = _lens(intrinsics)
    done, turn, shift = cv2.solvePnP(one.board_m, one.pixels, matrix, distortion)
    if not done:
        raise CalibrationError("no pose of the board fits one of the images; record them again")
    rotation = _OPTICAL_FROM_FRD.T @ cv2.Rodrigues(turn)[0]
    return rotation, _OPTICAL_FROM_FRD.T @ np.asarray(shift).ravel()


Transform = tuple[Points, Points]
Indices = NDArray[np.intp]


def _closed_form(
    track: _Track, times_s: Points, boards: Sequence[Transform]
) -> tuple[Transform, Transform, float]:
    """Return mounting and board in closed form, and how badly rotations agree.

    The body's motion between two images, A, and the board's in the camera, B, satisfy A X = X B
    for the mount X.
    """
    rotations, positions = track.at(times_s)
    turned = np.array([board[0] for board in boards])
    shifted = np.array([board[1] for board in boards])
    first, second = _informative_pairs(rotations)
    body_r = np.einsum("nji,njk->nik", rotations[first], rotations[second])
    camera_r = np.einsum("nij,nkj->nik", turned[first], turned[second])
    a, b = _logs(body_r), _logs(camera_r)
    u, _, vt = np.linalg.svd(b.T @ a)
    mount_r = vt.T @ np.diag([1.0, 1.0, np.linalg.det(vt.T @ u.T)]) @ u.T
    error = float(np.mean(np.linalg.norm(a - b @ mount_r.T, axis=1)))
    moved = np.einsum("nji,nj->ni", rotations[first], positions[second] - positions[first])
    camera_t = shifted[first] - np.einsum("nij,nj->ni", camera_r, shifted[second])
    left = (body_r - np.eye(3)).reshape(-1, 3)
    right = (camera_t @ mount_r.T - moved).ravel()
    mount_t = np.linalg.lstsq(left, right, rcond=None)[0]
    return (mount_r, mount_t), _board_of(rotations, positions, boards, (mount_r, mount_t)), error


def _board_of(
    rotations: Points, positions: Points, boards: Sequence[Transform], mount: Transform
) -> Transform:
    """Return the board's mean pose in the world for a mounting."""
    turns, places = [], []
    for body_r, body_t, (board_r, board_t) in zip(rotations, positions, boards, strict=True):
        turns.append(body_r @ mount[0] @ board_r)
        places.append(body_r @ (mount[0] @ board_t + mount[1]) + body_t)
    mean: Points = Rotation.from_matrix(np.array(turns)).mean().as_matrix()
    middle: Points = np.median(np.array(places), axis=0)
    return mean, middle


def _informative_pairs(rotations: Points) -> tuple[Indices, Indices]:
    """Return image pairs between which the body rotates enough for the mounting."""
    spaced = np.linspace(0, len(rotations) - 1, min(len(rotations), _SPACED)).astype(int)
    one, other = np.triu_indices(len(spaced), k=1)
    first, second = spaced[one], spaced[other]
    turns = _logs(np.einsum("nji,njk->nik", rotations[first], rotations[second]))
    is_informative = np.linalg.norm(turns, axis=1) > _LEAST_TURN_RAD
    axes = turns[is_informative]
    # The second axis of rotation must be excited as well, on average in each pair.
    least = _LEAST_OF_TWO * _LEAST_TURN_RAD * np.sqrt(len(axes))
    if len(axes) < FEWEST or np.linalg.svd(axes, compute_uv=False)[1] < least:
        raise CalibrationError(_move_more("it hardly rotated, or about one axis only"))
    return first[is_informative], second[is_informative]


def _lens(intrinsics: Intrinsics) -> tuple[Points, Points]:
    """Return camera matrix and distortion of intrinsics for the mounting fit."""
    i = intrinsics
    matrix = np.array([[i.fx_px, 0.0, i.cx_px], [0.0, i.fy_px, i.cy_px], [0.0, 0.0, 1.0]])
    return matrix, np.array(i.distortion or (0.0, 0.0, 0.0, 0.0))


def _logs(rotations: Points) -> Points:
    """Return rotation vectors (n, 3) of rotations (n, 3, 3)."""
    return np.asarray(Rotation.from_matrix(rotations).as_rotvec())


def _turn(vector: Points) -> Points:
    """Return the rotation matrix of a rotation vector in the mounting fit."""
    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def _parameters_of(transform: Transform) -> Points:
    return np.concatenate((transform[1], _logs(transform[0][None])[0]))


def _pose_of(vector: Points) -> Pose:
    """Return the mounting fit's six parameters as a pose."""
    x, y, z, w = Rotation.from_rotvec(vector[3:6]).as_quat()
    north, east, down = (float(value) for value in vector[:3])
    return Pose((north, east, down), (float(w), float(x), float(y), float(z)))
