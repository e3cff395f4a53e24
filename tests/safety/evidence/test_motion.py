"""Velocity and attitude that an oracle judges: frozen, zero and turned ones are no evidence."""

import math
import random
from collections.abc import Callable, Iterable
from dataclasses import replace

import pytest

from tests.safety.evidence.test_agreement import recorded
from wil_campaign.safety.evidence.agreement import SourceAccuracy
from wil_campaign.safety.evidence.evidence import Evidence
from wil_campaign.safety.evidence.terms import SignalTerms
from wil_campaign.safety.model.oracle_results import EvidenceResult
from wil_campaign.safety.model.samples import PoseSample, ReferenceSample, StageSample, StateSample
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.worlds.frames import Pose, Quat, Vec3

ESTIMATE = SourceAccuracy(1.0, 0.1, math.radians(2.0))
TRUTH = SourceAccuracy(0.0)
Change = Callable[[PoseSample], PoseSample]


def terms(signal: str) -> SignalTerms:
    return SignalTerms(
        signal=signal,
        vehicle="real",
        source="mavlink",
        limit_s=0.1,
        required=True,
        accuracy=ESTIMATE,
        references={"truth": TRUTH},
    )


def leaning(pitch_rad: float) -> Quat:
    return (math.cos(pitch_rad / 2.0), 0.0, math.sin(pitch_rad / 2.0), 0.0)


def flight() -> Iterable[PoseSample]:
    """Yield 8 s: a second at rest, then back and forth with 1.5 m/s, leaning by up to 12 deg."""
    noise = random.Random(1)  # noqa: S311 - repeatable
    for tick in range(400):
        t_s = tick / 50.0
        phase = max(0.0, t_s - 1.0)
        speed_m_s = 1.5 * math.sin(phase) + noise.gauss(0.0, 0.05)
        north_m = 1.5 * (1.0 - math.cos(phase)) + noise.gauss(0.0, 0.01)
        q = leaning(math.radians(12.0) * math.cos(phase) + noise.gauss(0.0, 0.005))
        yield PoseSample(t_s, "real", Pose((north_m, 0.0, -1.0), q), (speed_m_s, 0.0, 0.0))


def fly(signal: str, change: Change, *, has_truth: bool = True) -> EvidenceResult:
    evidence = Evidence([terms(signal)])
    evidence.stage(StageSample(0.0, "takeoff"))
    evidence.state(StateSample(0.0, "real", True, FlightMode.GUIDED, landed=False))
    for tick, true in enumerate(flight()):
        if has_truth and tick % 5 == 0:
            evidence.reference(
                ReferenceSample(
                    true.t_s, "real", "truth", true.pose.position_ned_m,
                    true.velocity_ned_m_s, true.pose.q_wxyz,
                )
            )  # fmt: skip
        evidence.pose(change(true) if true.t_s > 2.0 else true)
    (result,) = evidence.results()
    return result


def moving(factor: float = 1.0, offset_m_s: float = 0.0) -> Change:
    def changed(sample: PoseSample) -> PoseSample:
        north, east, down = sample.velocity_ned_m_s
        return sample._replace(velocity_ned_m_s=(north * factor + offset_m_s, east, down))

    return changed


def turned(pitch_rad: float | None) -> Change:
    def changed(sample: PoseSample) -> PoseSample:
        q = leaning(0.1) if pitch_rad is None else _more(sample.pose.q_wxyz, pitch_rad)
        return sample._replace(pose=Pose(sample.pose.position_ned_m, q))

    return changed


def _more(q: Quat, pitch_rad: float) -> Quat:
    return leaning(2.0 * math.atan2(q[2], q[0]) + pitch_rad)


@pytest.mark.parametrize("signal", ["velocity", "attitude"])
def test_motion_that_agrees_with_another_source_is_evidence(signal: str) -> None:
    result = fly(signal, moving())
    assert (result.verdict, result.reason) == ("PASS", "")
    assert result.compared_with == ("truth",)
    assert result.count > 300


@pytest.mark.parametrize("has_truth", [True, False])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (moving(0.0), "it repeats one velocity for 0.10 s"),
        (moving(0.001), "by it the vehicle moved 0."),
        (moving(0.3), "by it the vehicle moved 0."),
        (moving(1.0, 1.0), "by it the vehicle moved "),
    ],
)
def test_a_velocity_that_does_not_move_the_vehicle_is_none(
    change: Change, said: str, has_truth: bool
) -> None:
    result = fly("velocity", change, has_truth=has_truth)
    assert result.verdict == "INVALID"
    assert said in result.reason
    assert result.reason.startswith("velocity of real from mavlink: ")


def test_a_frozen_attitude_is_none_without_a_second_source() -> None:
    result = fly("attitude", turned(None), has_truth=False)
    assert result.reason.startswith(
        "attitude of real from mavlink: it repeats one attitude for 0.10 s"
    )


def test_an_attitude_that_leans_otherwise_than_truth_is_none() -> None:
    assert fly("attitude", turned(math.radians(9.0))).verdict == "PASS"
    result = fly("attitude", turned(math.radians(14.0)))
    assert result.verdict == "INVALID"
    assert "deg from where truth has the vehicle's vertical axis; the limit is" in result.reason
    assert "the limit is 10.0 deg" in result.reason


def test_a_heading_is_not_compared() -> None:
    level = Evidence([terms("attitude")])
    level.stage(StageSample(0.0, "takeoff"))
    for tick in range(100):
        t_s, wobble = tick / 50.0, 1e-4 * (tick % 7)
        north = (math.cos(0.2 + wobble), 0.0, 0.0, math.sin(0.2 + wobble))
        level.pose(PoseSample(t_s, "real", Pose((0.0, 0.0, -1.0), north), (0.0, 0.0, 0.0)))
        level.reference(
            ReferenceSample(t_s, "real", "truth", (0.0, 0.0, -1.0), (0.0, 0.0, 0.0), leaning(0.0))
        )
    (result,) = level.results()
    assert (result.verdict, result.compared_with) == ("PASS", ("truth",))


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_another_source_that_is_no_number_says_nothing(bad: float) -> None:
    evidence = Evidence([terms("pose"), terms("velocity"), terms("attitude")])
    evidence.stage(StageSample(0.0, "takeoff"))
    place: Vec3 = (bad, 0.0, 0.0)
    for tick in range(100):
        t_s = tick / 50.0
        evidence.reference(ReferenceSample(t_s, "real", "truth", place, (0.0, 0.0, 0.0)))
        evidence.pose(PoseSample(t_s, "real", Pose((t_s, 0.0, -1.0)), (1.0, 0.0, 0.0)))
    assert [result.compared_with for result in evidence.results()] == [(), (), ()]


@pytest.mark.parametrize(("seconds", "sources"), [(0.9, ()), (1.3, ("truth",))])
def test_a_source_counts_as_compared_after_a_second(
    seconds: float, sources: tuple[str, ...]
) -> None:
    evidence = Evidence([terms("velocity")])
    evidence.stage(StageSample(0.0, "takeoff"))
    for tick in range(round(seconds * 50)):
        place: Vec3 = (tick / 50.0, 0.0, -1.0)
        evidence.reference(ReferenceSample(tick / 50.0, "real", "truth", place, (1.0, 0.0, 0.0)))
        evidence.pose(PoseSample(tick / 50.0, "real", Pose(place), (1.0, 0.0, 0.0)))
    assert evidence.results()[0].compared_with == sources


def in_flight_of(name: str) -> EvidenceResult:
    """Return the evidence of the velocity in a flight of a real firmware."""
    evidence = Evidence([terms("velocity")])
    flight = recorded(name)
    evidence.stage(StageSample(flight[0].t_s, "takeoff"))
    for sample in flight:
        evidence.pose(sample)
    (result,) = evidence.results()
    return result


def test_the_velocity_of_real_ardupilot_moves_it_where_its_positions_do() -> None:
    result = in_flight_of("arducopter-4.7-guided")
    assert (result.verdict, result.reason) == ("PASS", "")
    assert result.count > 500


def test_the_velocity_of_real_px4_was_beside_its_positions() -> None:
    # 0.9 m/s apart while it landed: no speed can be judged by such a velocity.
    assert "by its own positions" in in_flight_of("px4-1.18-offboard").reason


def rounded(sample: PoseSample) -> PoseSample:
    """Return a sample that hovers on a grid: only its attitude still changes."""
    still = Pose((1.0, 0.0, -1.0), sample.pose.q_wxyz)
    return sample._replace(pose=still, velocity_ned_m_s=(0.0, 0.0, 0.0))


@pytest.mark.parametrize("signal", ["pose", "velocity"])
@pytest.mark.parametrize(
    ("on_grid", "frozen", "verdict"),
    [(False, False, "INVALID"), (True, False, "PASS"), (True, True, "INVALID")],
)
def test_a_grid_repeats_places_while_it_hovers_but_no_attitude(
    signal: str, on_grid: bool, frozen: bool, verdict: str
) -> None:
    source = replace(terms(signal), on_grid=on_grid, references={}, source="simulator")
    evidence = Evidence([source])
    evidence.stage(StageSample(0.0, "takeoff"))
    evidence.state(StateSample(0.0, "real", True, FlightMode.GUIDED, landed=False))
    for sample in flight():
        hovering = rounded(sample)
        evidence.pose(turned(None)(hovering) if frozen else hovering)
    (result,) = evidence.results()
    assert result.verdict == verdict
    assert ("it repeats one" in result.reason) is (verdict == "INVALID")


@pytest.mark.parametrize("signal", ["pose", "velocity"])
@pytest.mark.parametrize(
    ("on_grid", "stands_from_m", "reported_s", "verdict"),
    [
        (True, 0.0, 2.0, "PASS"),  # ArduCopter and PX4 report it within 3 s
        (True, 0.0, 3.5, "INVALID"),
        (True, 0.5, 2.0, "INVALID"),  # it was coming down: its source stopped
        (False, 0.0, 2.0, "INVALID"),  # what is measured does not repeat on the ground either
    ],
)
def test_a_simulated_vehicle_stands_to_the_last_bit_until_its_landing_is_reported(
    signal: str, on_grid: bool, stands_from_m: float, reported_s: float, verdict: str
) -> None:
    evidence = Evidence([replace(terms(signal), on_grid=on_grid, references={})])
    evidence.stage(StageSample(0.0, "takeoff"))
    evidence.stage(StageSample(0.0, "at_height"))
    evidence.stage(StageSample(0.01, "land"))
    evidence.state(StateSample(0.01, "real", True, FlightMode.LAND, landed=False))
    height_m, down_m_s = 1.0, 0.5
    stands_at_s = (height_m - stands_from_m) / down_m_s
    for tick in range(1, 300):
        t_s = tick / 50.0
        flies = t_s < stands_at_s
        moves_m_s = (1e-3 * math.sin(t_s), 0.0, down_m_s)
        if not flies and not stands_from_m:
            moves_m_s = (0.0, 0.0, 0.0)
        elif not flies:
            moves_m_s = (1e-3, 0.0, down_m_s)
        down_m = min(down_m_s * t_s - height_m, -stands_from_m)
        evidence.pose(PoseSample(t_s, "real", Pose((0.0, 0.0, down_m)), moves_m_s))
        if t_s >= stands_at_s + reported_s:
            evidence.state(StateSample(t_s, "real", True, FlightMode.LAND, landed=True))
    (result,) = evidence.results()
    assert result.verdict == verdict, result.reason
    assert ("it repeats one" in result.reason) is (verdict == "INVALID")
