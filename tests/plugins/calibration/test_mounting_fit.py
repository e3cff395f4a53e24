"""Mounting to 5 mm and 0.2 degrees, latency to 2 ms, with half a millimetre of noise."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.plugins.calibration.board_images import LENS, Hand
from wil_campaign.plugins.calibration.boards import CalibrationError
from wil_campaign.plugins.calibration.mounting import fit_mounting
from wil_campaign.worlds.frames import (
    AT_ORIGIN,
    Pose,
    angle_between,
    norm,
    quat_from_euler,
    subtract,
)

MOUNT = Pose((0.1, -0.02, 0.05), quat_from_euler(0.05, -0.1, 0.2))
HAND = Hand(MOUNT, 0.085)


@settings(max_examples=5, deadline=None)
@given(
    st.floats(0.0, 0.3),
    st.tuples(*[st.floats(-0.2, 0.2)] * 3),
    st.tuples(st.floats(-3.1, 3.1), st.floats(-0.25, 0.25), st.floats(-0.25, 0.25)),
)
def test_mounting_and_latency_are_recovered(
    latency_s: float, at_m: tuple[float, float, float], angles: tuple[float, float, float]
) -> None:
    hand = Hand(Pose(at_m, quat_from_euler(*angles)), latency_s)
    sightings = hand.sightings(16.0)
    fit = fit_mounting(sightings, hand.path(17.0), LENS)
    assert norm(subtract(fit.mount.position_ned_m, at_m)) < 0.005
    assert angle_between(fit.mount.q_wxyz, hand.mount.q_wxyz) < math.radians(0.2)
    assert fit.latency_s == pytest.approx(latency_s, abs=0.002)
    assert fit.rms_px < 1.5
    assert fit.spread_m < 0.005


def test_a_body_that_is_not_turned_tells_nothing() -> None:
    still = replace(HAND, turn_deg=0.5)
    with pytest.raises(
        CalibrationError, match=r"the mounting cannot be determined .* turn the body by"
    ):
        fit_mounting(still.sightings(16.0), still.path(17.0), LENS)


def test_too_few_images_with_a_pose_are_refused() -> None:
    with pytest.raises(CalibrationError, match="images show the board while the body's pose"):
        fit_mounting(HAND.sightings(16.0)[:40], HAND.path(2.0), LENS)
    with pytest.raises(CalibrationError, match="no poses arrived"):
        fit_mounting(HAND.sightings(4.0), HAND.path(0.0), LENS)


def test_the_poses_of_another_body_do_not_fit() -> None:
    other = Hand(AT_ORIGIN, 0.0, hz=0.23, sway_m=0.4)
    with pytest.raises(
        CalibrationError, match=r"do not fit: .* px off; check that the board did not move"
    ):
        fit_mounting(HAND.sightings(16.0), other.path(17.0), LENS)


def test_poses_that_come_twice_or_in_disorder_do_no_harm() -> None:
    path = HAND.path(17.0)
    order = np.concatenate((np.arange(len(path.t_s))[::-1], [5, 7, 7]))
    shuffled = replace(
        path,
        t_s=path.t_s[order],
        position_ned_m=path.position_ned_m[order],
        q_wxyz=path.q_wxyz[order],
    )
    sightings = HAND.sightings(16.0)
    straight = fit_mounting(sightings, path, LENS)
    fit = fit_mounting(sightings, shuffled, LENS)
    assert fit.latency_s == pytest.approx(straight.latency_s, abs=1e-6)


@pytest.mark.parametrize("hz", [100.0, 10.0])
def test_images_while_the_body_was_hidden_are_left_out(hz: float) -> None:
    """A line was drawn across the gap: 'do not fit: 5.9 px off; check that the board did not move'.

    After a gap of 0.4 s the figures were of 4 px.
    """
    path = HAND.path(17.0, hz=hz)
    there = ~((path.t_s > 5.0) & (path.t_s < 6.0))
    hidden = replace(
        path,
        t_s=path.t_s[there],
        position_ned_m=path.position_ned_m[there],
        q_wxyz=path.q_wxyz[there],
    )
    sightings = HAND.sightings(16.0)
    whole, fit = (fit_mounting(sightings, each, LENS) for each in (path, hidden))
    assert fit.images == whole.images - 10  # that were taken within, or up to 0.5 s after it
    assert fit.rms_px < 0.7
    assert norm(subtract(fit.mount.position_ned_m, MOUNT.position_ned_m)) < 0.006
