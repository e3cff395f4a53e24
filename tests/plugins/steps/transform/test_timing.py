"""Resampling and delay: the right reading for a time, its time told, and its gap bounded."""

from typing import Any, TypeVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.recipes.samples import beam, build, camera, cloud, fix, imu, pose, scan
from wil_campaign.plugins.steps.operations.interpolation import INTERPOLATED, interpolated_reading
from wil_campaign.recipes.working import CannotMixError, Masked
from wil_campaign.vehicles.readings import Reading
from wil_campaign.worlds.frames import Pose, angle_between, quat_from_euler

R = TypeVar("R", bound=Reading)


def line(t_s: float, source: Any = "twin") -> Any:
    """A vehicle that goes north at 2 m/s."""
    return pose(Pose((2 * t_s, 0, 0)), source, t_s=t_s, seq=round(t_s * 10))


def used(how: str, offered: list[float], real_s: float, **options: Any) -> Any:
    step = build("resample", how=how, **options)
    for t_s in offered[:-1]:
        step.offer(line(t_s))
    return step(Masked(line(offered[-1])), Masked(line(real_s, "real"))).reading


def test_latest_hold_and_interpolate() -> None:
    offered = [0.0, 0.1, 0.2, 0.3]
    assert used("latest", offered, 0.15).t_s == 0.3
    assert used("hold", offered, 0.15).t_s == 0.1
    assert used("hold", offered, 0.2).t_s == 0.2
    made = used("interpolate", offered, 0.17)
    assert made.t_s == 0.17
    assert made.pose.position_ned_m[0] == pytest.approx(0.34)
    assert used("interpolate", offered, 0.35).t_s == 0.3


@given(st.lists(st.floats(0, 5), min_size=1, max_size=30, unique=True), st.floats(0, 5))
def test_no_reading_from_the_future_is_held(times: list[float], real_s: float) -> None:
    times = sorted(times)
    before = [t_s for t_s in times if t_s <= real_s]
    if before:
        assert used("hold", times, real_s, max_gap_ms=6000.0).t_s == before[-1]
        made = used("interpolate", times, real_s, max_gap_ms=6000.0)
        assert made.pose.position_ned_m[0] == pytest.approx(2 * made.t_s, abs=1e-6)
    else:
        with pytest.raises(CannotMixError) as caught:
            used("hold", times, real_s, max_gap_ms=6000.0)
        assert caught.value.reason == "no_history"


def test_a_gap_is_bounded() -> None:
    with pytest.raises(CannotMixError) as caught:
        used("hold", [0.0, 0.1], 0.5, max_gap_ms=300.0)
    assert caught.value.reason == "stale"
    assert str(caught.value) == "resample: the reading is 400 ms away, more than max_gap_ms 300"
    # The two around it are too far apart: the one before is near enough.
    assert used("interpolate", [0.0, 0.9], 0.2, max_gap_ms=300.0).t_s == 0.0


def made_between(one: R, other: R, fraction: float) -> R:
    """Return the reading between two of one kind, which there is."""
    made = interpolated_reading(one, other, fraction)
    assert isinstance(made, type(one))
    return made


def test_between_two_readings_of_each_kind() -> None:
    half = made_between(imu(t_s=0.0), imu(t_s=1.0, rates_frd_rad_s=(1.0, 0.02, 0.03)), 0.5)
    assert half.rates_frd_rad_s[0] == pytest.approx(0.505)
    one = fix(1, 179.5, t_s=0.0, satellites=9)
    found = made_between(one, fix(2, -179.5, t_s=1.0, satellites=7), 0.25)
    assert (found.latitude_deg, found.longitude_deg, found.satellites) == (1.25, 179.75, 7)
    inf = float("inf")
    assert made_between(beam(2.0, t_s=0.0), beam(4.0, t_s=1.0), 0.25).range_m == 2.5
    assert made_between(beam(2.0, t_s=0.0), beam(inf, t_s=1.0), 0.25).range_m == 2.0
    assert made_between(beam(2.0, t_s=0.0), beam(inf, t_s=1.0), 0.75).range_m == inf
    made = made_between(scan([1, inf], t_s=0.0), scan([3, 5], t_s=1.0), 0.75)
    assert made.ranges_m.tolist() == [2.5, 5.0]
    turned = made_between(
        pose(t_s=0.0), pose(Pose((1, 2, 3), quat_from_euler(0, 0, 1.0)), t_s=1.0), 0.5
    )
    assert angle_between(turned.pose.q_wxyz, quat_from_euler(0, 0, 0.5)) < 1e-9
    assert interpolated_reading(scan([1], t_s=0.0), scan([1, 2], t_s=1.0), 0.5) is None
    east = scan([1, 2], t_s=1.0, start_angle_rad=0.0)
    assert interpolated_reading(scan([1, 2], t_s=0.0), east, 0.5) is None
    assert (
        interpolated_reading(cloud([[1, 2, 3]], t_s=0.0), cloud([[1, 2, 3]], t_s=1.0), 0.5) is None
    )


def test_only_types_with_a_between_can_be_interpolated() -> None:
    parameters = build.__globals__["find_step"]("resample").parameters(how="interpolate")
    assert not any(parameters.refuses(kind) for kind in INTERPOLATED)
    assert "cannot be interpolated" in parameters.refuses("camera")


def test_a_delay_uses_what_is_old_enough_and_says_its_time() -> None:
    step = build("delay", by_ms=100.0)
    for k in range(3):
        with pytest.raises(CannotMixError) as caught:
            step(Masked(line(k * 0.04)), None)
        assert caught.value.reason == "no_history"
    times = [step(Masked(line(k * 0.04)), None).reading.t_s for k in range(3, 8)]
    assert times == pytest.approx([0.0, 0.04, 0.08, 0.12, 0.16])


@given(st.lists(st.floats(0, 10), min_size=1, max_size=60), st.floats(0, 2000))
def test_a_delayed_reading_is_the_newest_old_enough(times: list[float], by_ms: float) -> None:
    step = build("delay", by_ms=by_ms)
    seen: list[float] = []
    for t_s in times:
        if not seen or t_s > seen[-1]:
            seen.append(t_s)
            old = [one for one in seen if one <= t_s - by_ms / 1000 + 1e-9]
            if old:
                assert step(Masked(line(t_s)), None).reading.t_s == old[-1]
            else:
                with pytest.raises(CannotMixError):
                    step(Masked(line(t_s)), None)


@pytest.mark.parametrize("by_ms", [80.0, 300.0, 2000.0])
@pytest.mark.parametrize("behind", [0, 1, 8])
def test_a_delay_counts_from_the_reading_that_is_mixed(by_ms: float, behind: int) -> None:
    """The other side's come later, so that newer ones are there: of an image nothing was left."""
    step, images = build("delay", by_ms=by_ms), [camera(t_s=k / 15, seq=k) for k in range(90)]
    for image in images:
        step.offer(image)
    mixed = images[-1 - behind]
    found = step(Masked(mixed), None).reading
    assert 0.0 <= mixed.t_s - by_ms / 1000 - found.t_s + 1e-6 < 1 / 15 + 1e-6


def test_a_reading_is_held_though_newer_ones_than_its_gap_are_there() -> None:
    times = [k / 15 for k in range(30)]
    step = build("resample", how="hold", max_gap_ms=20.0)
    for t_s in times:
        step.offer(line(t_s))
    held = step(Masked(line(times[-3])), Masked(line(times[-4] + 0.01, "real"))).reading
    assert held.t_s == times[-4]


def test_memory_of_images_is_bounded() -> None:
    step = build("resample", how="hold", max_gap_ms=60_000.0)
    for k in range(100):
        step.offer(camera(t_s=k * 0.01))
    assert len(step._memory._readings) == 16


def test_the_same_reading_again_changes_nothing() -> None:
    step = build("resample", how="hold")
    held = line(0.5)
    for _ in range(3):
        assert step(Masked(held), Masked(line(0.6, "real"))).reading is held
    assert np.isclose(held.t_s, 0.5)


def test_a_long_delay_keeps_as_many_images_as_it_spans() -> None:
    step = build("delay", by_ms=2000.0)
    for k in range(100):
        step.offer(camera(t_s=k / 30))
    assert step.offer(camera(t_s=100 / 30)).t_s == pytest.approx(40 / 30)
    assert 90 <= len(step._memory._readings) <= 92  # and a second more, for late mixtures
