"""A share of the seeded kills; `bench/faults.py` injects hundreds."""

from pathlib import Path

import pytest

from tests.faults.virtual import VICTIMS, draw, inject

SEEDS = (2, 3, 5, 9)
"""guard, orchestrator, judging, source."""


@pytest.mark.parametrize("seed", SEEDS)
def test_whoever_dies_both_come_down_and_nothing_passes(tmp_path: Path, seed: int) -> None:
    aftermath = inject(draw(seed), tmp_path / "run")
    assert aftermath.lost == ()
    assert aftermath.hit != "nobody"


def test_the_moments_and_victims_are_those_of_the_seed() -> None:
    assert draw(7) == draw(7)
    assert len({draw(seed).at_s for seed in range(100)}) > 90
    assert {draw(seed).victim for seed in range(24)} == set(VICTIMS)
    assert {draw(seed).campaign for seed in range(24)} == {"gate", "gate-ardupilot"}
