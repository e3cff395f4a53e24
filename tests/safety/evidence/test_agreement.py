"""Two sources of one vehicle's place: what they may differ by, and what excludes each other."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from wil_campaign.safety.evidence.agreement import (
    Disagreement,
    PositionAgreement,
    SourceAccuracy,
    StandingStill,
    VelocityAgreement,
)
from wil_campaign.safety.model.samples import PoseSample, ReferenceSample
from wil_campaign.worlds.frames import Pose, Vec3

TRACES = Path(__file__).parents[2] / "vehicles" / "traces"
CAPTURED = SourceAccuracy(0.002)
ESTIMATED = SourceAccuracy(1.0, 0.1)
TRUTH = SourceAccuracy(0.0)
SPEED_M_S = 0.8

Place = Callable[[float], Vec3]


def straight(t_s: float) -> Vec3:
    return (SPEED_M_S * t_s, 0.0, -1.2)


def frozen(t_s: float) -> Vec3:
    return straight(min(t_s, 3.0))


def first(
    judged: Place,
    *,
    other: Place = straight,
    velocity: Vec3 = (SPEED_M_S, 0.0, 0.0),
    by: tuple[SourceAccuracy, SourceAccuracy] = (CAPTURED, ESTIMATED),
    late_s: float = 0.0,
    for_s: float = 10.0,
) -> Disagreement | None:
    """Return the first disagreement of two sources over a flight of ten seconds."""
    agreement = PositionAgreement(judged=by[0], other=by[1], source="the other")
    found: list[Disagreement | None] = []
    for tick in range(int(for_s * 50)):
        t_s = tick / 50
        found.append(agreement.pose(PoseSample(t_s, "real", Pose(judged(t_s)), velocity)))
        if tick % 5 == 0 and t_s >= late_s:
            then_s = t_s - late_s
            sample = ReferenceSample(then_s, "real", "mavlink", other(then_s), velocity)
            found.append(agreement.reference(sample))
    return next((one for one in found if one is not None), None)


def test_sources_that_agree_are_compared_and_let_alone() -> None:
    for by in ((CAPTURED, ESTIMATED), (ESTIMATED, CAPTURED), (CAPTURED, TRUTH)):
        assert first(straight, by=by) is None
        assert first(straight, by=by, late_s=0.3) is None


def test_a_tracker_that_repeats_its_last_pose_with_noise_is_found_within_a_second() -> None:
    rng = np.random.default_rng(1)

    def noisy(t_s: float) -> Vec3:
        north_m, east_m, down_m = frozen(t_s)
        noise = rng.normal(0.0, 0.001, 3)
        return (north_m + noise[0], east_m + noise[1], down_m + noise[2])

    found = first(noisy)
    assert found is not None
    assert 3.0 < found.at_s < 4.0


def test_a_jump_and_a_bias_are_found_by_the_accuracy_of_both() -> None:
    def jumped(t_s: float) -> Vec3:
        return (straight(t_s)[0] + (1.0 if t_s >= 4.0 else 0.0), 0.0, -1.2)

    found = first(jumped)
    assert found is not None
    assert found.at_s == pytest.approx(4.0)
    assert found.text == (
        "it moved 1.16 m within 0.20 s, by the other the vehicle moved 0.16 m; the limit "
        "is 0.10 m on each axis"
    )

    def biased(t_s: float) -> Vec3:
        return (straight(t_s)[0] + 0.3, 0.0, -1.2)

    assert first(biased) is None
    against_truth = first(biased, by=(CAPTURED, TRUTH))
    assert against_truth is not None
    assert against_truth.text.startswith("it is 0.30 m from the position by the other; ")


@pytest.mark.parametrize("other", [CAPTURED, TRUTH])
@pytest.mark.parametrize(("off_m", "is_found"), [(0.4, False), (0.6, True), (-1.4, True)])
def test_a_better_source_bounds_the_error_of_an_estimate(
    other: SourceAccuracy, off_m: float, is_found: bool
) -> None:
    def low(t_s: float) -> Vec3:
        return (straight(t_s)[0], 0.0, -1.2 + off_m)

    found = first(low, by=(ESTIMATED, other))
    assert (found is not None) == is_found
    if found is not None:
        # And the way of a tenth of a second, for times that are mapped inexactly.
        assert found.text.endswith("by the other; the limit is 0.58 m on each axis")
    # A worse source bounds nothing beyond what it states.
    assert first(low, by=(CAPTURED, ESTIMATED)) is None


def test_a_step_of_an_estimate_is_found_by_a_better_source() -> None:
    def stepped(t_s: float) -> Vec3:
        return (straight(t_s)[0], 0.15 if t_s >= 4.0 else 0.0, -1.2)

    found = first(stepped, by=(ESTIMATED, TRUTH))
    assert found is not None
    assert found.at_s == pytest.approx(4.0)
    assert found.text.startswith("it moved 0.22 m within 0.20 s, by the other")


def test_a_velocity_that_its_own_positions_contradict_excludes_no_source() -> None:
    # PX4 1.18 descended so in SITL: 0.9 m/s aside by its velocity, and nowhere by its positions.
    assert first(straight, velocity=(SPEED_M_S, 0.9, 0.0)) is None
    found = first(frozen, velocity=(SPEED_M_S, 0.9, 0.0))
    assert found is not None


def test_times_that_are_mapped_inexactly_exclude_no_vehicle_that_brakes_hard() -> None:
    def braking(t_s: float) -> Vec3:
        return (0.5 * 10.0 * min(t_s, 0.5) ** 2 + 5.0 * max(0.0, t_s - 0.5), 0.0, -1.2)

    agreement = PositionAgreement(judged=CAPTURED, other=ESTIMATED, source="the other")
    found: list[Disagreement | None] = []
    for tick in range(100):
        t_s = tick / 50
        velocity = (10.0 * min(t_s, 0.5), 0.0, 0.0)
        late = Pose(braking(max(0.0, t_s - 0.1)))
        found.append(agreement.pose(PoseSample(t_s, "real", late, velocity)))
        found.append(
            agreement.reference(ReferenceSample(t_s, "real", "mavlink", braking(t_s), velocity))
        )
    assert not any(found)


def own(north_m: Callable[[float], float], velocity_m_s: float) -> Disagreement | None:
    """Return the first step of a place beside its own velocity, over ten seconds."""
    source = VelocityAgreement()
    found = [
        source.pose(
            PoseSample(tick / 50, "real", Pose((north_m(tick / 50), 0, -1)), (velocity_m_s, 0, 0))
        )
        for tick in range(500)
    ]
    return next((one for one in found if one is not None), None)


def test_a_place_that_steps_beside_its_own_velocity_is_found_without_a_second_source() -> None:
    assert own(lambda t_s: 2.0 * t_s, 2.0) is None
    assert own(lambda t_s: 2.0 * t_s + (0.4 if t_s >= 4.0 else 0.0), 2.0) is None
    found = own(lambda t_s: 2.0 * t_s + (0.7 if t_s >= 4.0 else 0.0), 2.0)
    assert found is not None
    assert found.at_s == pytest.approx(4.0)
    assert found.text == (
        "it moved 1.10 m within 0.20 s, by its own velocity 0.40 m; the limit is 0.50 m "
        "on each axis"
    )
    # As far as the real PX4 1.18 was off in flight.
    assert own(lambda t_s: 0.0, 1.0) is None


def test_stated_noise_disagrees_in_no_flight() -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        drift = rng.normal(0.0, 1.0, 3)

        def drifted(t_s: float, drift: np.ndarray = drift) -> Vec3:
            return (SPEED_M_S * t_s + drift[0], drift[1], -1.2 + drift[2])

        def seen(t_s: float, rng: np.random.Generator = rng) -> Vec3:
            noise = rng.normal(0.0, 0.002, 3)
            return (SPEED_M_S * t_s + noise[0], noise[1], -1.2 + noise[2])

        wrong_m_s = rng.normal(0.0, 0.1, 3)
        velocity = (SPEED_M_S + wrong_m_s[0], wrong_m_s[1], wrong_m_s[2])
        assert first(seen, other=drifted, velocity=velocity) is None


def test_displacements_are_as_exact_as_the_better_of_places_and_velocity() -> None:
    assert SourceAccuracy(1.0, 0.1).displacement_m(1.0) == pytest.approx(0.1)
    assert SourceAccuracy(0.01, 0.1).displacement_m(1.0) == pytest.approx(0.01 * math.sqrt(2.0))
    assert SourceAccuracy(0.01).displacement_m(1.0) == pytest.approx(0.01 * math.sqrt(2.0))


def test_a_silence_of_the_other_source_is_not_integrated_over() -> None:
    agreement = PositionAgreement(judged=CAPTURED, other=ESTIMATED, source="the other")
    found: list[Disagreement | None] = []
    for tick in range(500):
        t_s = tick / 50
        there = (4.0, 0.0, 0.0) if t_s >= 4.2 else (0.0, 0.0, 0.0)
        place = (4.0 * max(0.0, t_s - 4.2), 0.0, -1.0)
        found.append(agreement.pose(PoseSample(t_s, "real", Pose(place), there)))
        if tick % 5 == 0 and not 4.0 < t_s < 7.0:
            found.append(agreement.reference(ReferenceSample(t_s, "real", "mavlink", place, there)))
    assert not any(found)


def recorded(name: str) -> list[PoseSample]:
    """Return LOCAL_POSITION_NED of a real firmware's flight in its simulation, while armed."""
    path = TRACES / f"{name}-positions.csv"
    rows = [line.split(",") for line in path.read_text("utf-8").splitlines()[1:]]
    samples = []
    for row in rows:
        t_s, north_m, east_m, down_m, *velocity_m_s = (int(cell) / 1e3 for cell in row)
        vn, ve, vd = velocity_m_s
        samples.append(PoseSample(t_s, "real", Pose((north_m, east_m, down_m)), (vn, ve, vd)))
    return samples


@pytest.mark.parametrize("name", ["px4-1.18-offboard", "arducopter-4.7-guided"])
def test_sources_agree_in_flights_of_the_real_firmwares(name: str) -> None:
    flight = recorded(name)
    assert flight[-1].t_s - flight[0].t_s > 25.0
    source = VelocityAgreement()
    assert not any(source.pose(sample) for sample in flight)
    # Motion capture beside it sees where it goes; its velocity is off by 0.9 m/s in PX4's flight.
    agreement = PositionAgreement(judged=CAPTURED, other=ESTIMATED, source="mavlink")
    for sample in flight:
        place = sample.pose.position_ned_m
        assert agreement.pose(sample) is None
        reference = ReferenceSample(sample.t_s, "real", "mavlink", place, sample.velocity_ned_m_s)
        assert agreement.reference(reference) is None
    assert agreement.count > 500


def test_a_step_in_the_flight_of_a_real_firmware_is_found() -> None:
    source = VelocityAgreement()
    flight = recorded("arducopter-4.7-guided")
    found = []
    for sample in flight:
        north_m, east_m, down_m = sample.pose.position_ned_m
        by_m = 0.6 if sample.t_s > flight[0].t_s + 15.0 else 0.0
        found.append(source.pose(sample._replace(pose=Pose((north_m, east_m + by_m, down_m)))))
    assert any(found)


def still_until(
    moves_s: float, *, estimate: Callable[[float], float], until_s: float = 8.0
) -> Disagreement | None:
    """Return what is found of places that repeat until a time, beside an estimate's north."""
    still = StandingStill()
    for tick in range(int(until_s * 50)):
        t_s = tick / 50
        north_m = 0.011 * tick if t_s >= moves_s else 0.0
        still.pose(PoseSample(t_s, "real", Pose((north_m, 0.0, -1.0)), (0.0, 0.0, 0.0)))
        place: Vec3 = (estimate(t_s), 0.0, -1.0)
        found = still.reference(ReferenceSample(t_s, "real", "mavlink", place, (0.0, 0.0, 0.0)))
        if found is not None:
            return found
    return None


def test_a_place_that_repeats_while_the_estimate_goes_away_is_found() -> None:
    found = still_until(99.0, estimate=lambda t_s: 0.7 * t_s)
    assert found is not None
    assert 1.6 < found.at_s < 1.8
    assert found.text.startswith("it repeats one place for 1.72 s, while mavlink moved 1.2")


def test_a_vehicle_that_hovers_on_a_grid_may_stand_still_for_long() -> None:
    assert still_until(99.0, estimate=lambda t_s: 0.2 * math.sin(t_s)) is None


def test_an_estimate_that_steps_has_moved_its_vehicle_within_a_second() -> None:
    def stepped(t_s: float) -> float:
        return 0.8 if t_s >= 4.0 else 0.0

    assert still_until(4.3, estimate=stepped) is None
    found = still_until(99.0, estimate=stepped)
    assert found is not None
    assert found.at_s == pytest.approx(5.0)
