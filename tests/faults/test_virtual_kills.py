"""A share of the seeded faults in virtual time; `bench/faults.py` injects hundreds."""

from pathlib import Path

import pytest

from tests.faults.barriers import acted_after_s, late
from tests.faults.draws import TROUBLES, VICTIMS, Fault, draw_kill, draw_trouble
from tests.faults.virtual import inject
from tests.faults.witness import GATE_EAST_M, Sight, Witness

KILLS = (2, 3, 5, 9)
"""guard, orchestrator, judging, source."""
TROUBLED = (3, 7, 9, 10, 77)
"""garbage, forged, disk full, folder read-only, replayed while it lands."""


@pytest.mark.parametrize("seed", KILLS)
def test_both_vehicles_come_down_and_nothing_passes_after_any_kill(
    tmp_path: Path, seed: int
) -> None:
    aftermath = inject(draw_kill(seed), tmp_path / "run")
    assert aftermath.lost == ()
    assert aftermath.hit != "nobody"


@pytest.mark.parametrize("seed", TROUBLED)
def test_both_vehicles_come_down_after_any_trouble(tmp_path: Path, seed: int) -> None:
    aftermath = inject(draw_trouble(seed), tmp_path / "run")
    assert aftermath.lost == ()
    assert aftermath.stage != "over"


def test_a_step_of_the_wall_clock_changes_nothing(tmp_path: Path) -> None:
    fault = Fault(1, "gate", "trouble", "clock jump", at_s=18.0)
    aftermath = inject(fault, tmp_path / "run")
    assert aftermath.lost == ()
    assert (aftermath.hit, aftermath.verdict) == ("clock jump", "PASS")


def test_the_moments_and_victims_are_those_of_the_seed() -> None:
    for draw, victims in ((draw_kill, VICTIMS), (draw_trouble, TROUBLES)):
        assert draw(7) == draw(7)
        assert len({draw(seed).at_s for seed in range(100)}) > 90
        assert {draw(seed).victim for seed in range(24)} == set(victims)
        assert {draw(seed).campaign for seed in range(24)} == {"gate", "gate-ardupilot"}
    assert {draw_kill(seed).kind for seed in range(72)} == {"kill", "stop"}


def flown(armed: bool, up_m: float, sink_m_s: float = 0.5) -> Sight:
    sight = Sight()
    for t_s, north_m, height_m in ((0.0, 0.0, 1.2), (1.0, 4.0, 1.2)):
        sight.see(t_s, (north_m, GATE_EAST_M, height_m, 0.0), armed=True)
    sight.see(5.0, (4.0, GATE_EAST_M, up_m, sink_m_s), armed)
    return sight


def test_the_witness_tells_a_landing_from_anything_else() -> None:
    witness = Witness({})
    witness.sights = {"real": flown(armed=False, up_m=0.0)}
    assert witness.not_completed() == []
    assert not witness.sights["real"].fell
    for sight in (flown(armed=True, up_m=0.0), flown(armed=False, up_m=0.8), Sight()):
        witness.sights = {"real": sight}
        assert witness.not_completed()
    assert flown(armed=False, up_m=0.0, sink_m_s=3.0).fell


def test_a_guard_that_leaves_it_to_the_failsafes_is_found_out() -> None:
    landed = {"twin": flown(armed=False, up_m=0.0)}
    events = [(2.0, "silence"), (1.7, "action"), (0.5, "lost")]
    assert acted_after_s(events, 1.0) == 1.0
    assert late(1.0, 1.5, 1.0, landed) == []
    assert late(1.0, 0.5, 1.0, landed)
    assert late(None, 0.5, 1.0, landed)
    assert late(None, 0.5, 5.0, landed) == []
