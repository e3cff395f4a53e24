"""A share of the flights that must fail; `python bench/must_fail.py` flies a thousand."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.faults.alterations import KINDS, POSSIBLE, Alteration
from tests.faults.missions import CAUSES
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


def test_an_estimate_that_leads_above_a_table_is_found_by_what_stands_beside_it(
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
