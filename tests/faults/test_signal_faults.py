"""A share of the flights that must fail; `python bench/must_fail.py` flies a thousand."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.faults import ground_truth
from tests.faults.alterations import KINDS, POSSIBLE, Alteration, Kind
from tests.faults.missions import CAUSES, AutopilotKind
from tests.faults.signals import (
    draw,
    inject,
    shown_by_none,
)

SEEDS = (9, 205, 347)
"""A step of motion capture's clock, NaN, pictures that freeze."""


@pytest.mark.parametrize("seed", SEEDS)
def test_no_fault_of_a_signal_makes_a_flight_pass_that_must_fail(tmp_path: Path, seed: int) -> None:
    outcome = inject(draw(seed), tmp_path / "flight")
    assert outcome.verdict in {"FAIL", "INVALID"}
    assert outcome.reason
    assert not outcome.wrong


def test_another_source_finds_an_estimate_that_leads_above_a_table(
    tmp_path: Path,
) -> None:
    alteration = Alteration("bias", (0.0, 0.0, -0.45), 0.0)
    fault = replace(
        draw(0), cause="table", signal="position", lone=False, stage="at_height",
        after_s=0.0, alteration=alteration,
    )  # fmt: skip
    assert (fault.mode, fault.judged_by) == ("sim", "mavlink")
    outcome = inject(fault, tmp_path / "flight")
    assert outcome.verdict == "INVALID"
    assert "pose of twin from mavlink: it moved 0.4" in outcome.reason
    assert not outcome.exempt


def test_a_velocity_that_its_gps_receiver_contradicts_is_no_evidence(tmp_path: Path) -> None:
    fault = replace(
        draw(0), cause="speed", autopilot="ardupilot", signal="ground speed", stage="takeoff",
        lone=True, after_s=1.0, alteration=Alteration("bias", (1.2, 0.0, 0.0), 0.0),
    )  # fmt: skip
    assert (fault.mode, fault.judged_by) == ("sim", "mavlink")
    outcome = inject(fault, tmp_path / "flight")
    assert outcome.verdict == "INVALID"
    assert re.search(r"^velocity of twin from mavlink: .* by gps 1\.2\d m/s", outcome.reason)


@pytest.mark.parametrize(
    ("signal", "kind", "autopilot", "said"),
    [
        ("ground truth", "stop", "px4", "pose of twin from simulator: no sample for "),
        ("ground truth", "nan", "ardupilot", "pose of twin from simulator: no sample for "),
        ("ground truth", "freeze", "px4", "pose of twin from simulator: it repeats one position"),
        ("places", "freeze", "ardupilot", "velocity of twin from simulator: by it the vehicle"),
        ("places", "jump", "px4", "pose of twin from simulator: it moved 0."),
    ],
)
def test_a_ground_truth_that_is_alone_and_fails_before_a_wall_proves_nothing(
    tmp_path: Path, signal: str, kind: Kind, autopilot: AutopilotKind, said: str
) -> None:
    fault = replace(
        ground_truth.draw_truth(0), cause="wall", autopilot=autopilot, signal=signal,
        stage="goal", after_s=0.5, alteration=Alteration(kind, (0.0, 0.7, 0.0), 0.0),
    )  # fmt: skip
    assert (fault.mode, fault.judged_by, fault.lone) == ("sim", "simulator", True)
    outcome = inject(fault, tmp_path / "flight")
    assert outcome.verdict == "INVALID"
    assert outcome.reason.startswith(said)


def test_the_faults_are_those_of_the_seed_and_cover_all_kinds() -> None:
    assert draw(7) == draw(7)
    drawn = [draw(seed) for seed in range(1000)]
    assert {one.kind for one in drawn} == set(KINDS)
    assert {one.cause for one in drawn} == set(CAUSES)
    assert {(one.signal, one.kind) for one in drawn} == {
        (signal, kind) for signal, kinds in POSSIBLE.items() for kind in kinds
    }
    assert {(one.mode, one.vehicle) for one in drawn} == {
        ("sim", "twin"), ("wil", "real"), ("wil", "twin")
    }  # fmt: skip
    # Where the judged vehicle is and how far it leans cannot be checked of an estimate that is
    # alone; its charge and its estimator's status nobody else says.
    exempt = [one for one in drawn if shown_by_none(one)]
    of_estimates = [one for one in exempt if one.signal in {"position", "attitude"}]
    assert {(one.kind, one.judged_by, one.lone) for one in of_estimates} == {
        ("bias", "mavlink", True), ("jump", "mavlink", True)
    }  # fmt: skip
    said_alone = [one for one in exempt if one not in of_estimates]
    assert {(one.cause, one.signal) for one in said_alone} == {
        ("battery", "battery"), ("estimator", "estimator")
    }  # fmt: skip
    assert all(one.kind not in {"stop", "delay"} for one in exempt)
    assert len(exempt) < len(drawn) / 16


def test_the_faults_of_a_ground_truth_cover_all_kinds_and_are_never_exempt() -> None:
    drawn = [ground_truth.draw_truth(seed) for seed in range(400)]
    assert {(one.signal, one.kind) for one in drawn} == {
        (signal, kind) for signal, kinds in ground_truth.POSSIBLE.items() for kind in kinds
    }
    assert {one.judged_by for one in drawn} == {"simulator"}
    assert {one.autopilot for one in drawn} == {"ardupilot", "px4"}
    assert all(one.lone and one.vehicle == one.subject for one in drawn)
    assert not any(map(shown_by_none, drawn))
