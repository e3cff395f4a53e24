"""A share of the flights that must fail; `python -m tests.faults.signals` flies hundreds."""

from pathlib import Path

import pytest

from tests.faults.signals import KINDS, MISSIONS, draw, inject, shown_by_none

SEEDS = (5, 9, 26, 55)
"""NaN, freeze, delay and a step of the clock."""


@pytest.mark.parametrize("seed", SEEDS)
def test_no_fault_of_a_signal_makes_a_flight_pass_that_must_fail(tmp_path: Path, seed: int) -> None:
    outcome = inject(draw(seed), tmp_path / "flight")
    assert outcome.verdict in {"FAIL", "INVALID"}
    assert outcome.reason
    assert not outcome.wrong


def test_the_faults_are_those_of_the_seed_and_cover_all_kinds() -> None:
    assert draw(7) == draw(7)
    drawn = [draw(seed) for seed in range(64)]
    assert {one.kind for one in drawn} == set(KINDS)
    assert {one.cause for one in drawn} == set(MISSIONS)
    assert {one.lone for one in drawn} == {True, False}
    # Of a source that is alone, only where it says that the vehicle is cannot be checked.
    assert {one.kind for one in drawn if shown_by_none(one)} == {"bias", "jump"}
