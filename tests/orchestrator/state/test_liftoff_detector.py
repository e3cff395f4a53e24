"""When a vehicle lifted: heights as real autopilots gave them, which drift on the ground."""

from itertools import count
from types import SimpleNamespace
from typing import Any, cast

import pytest

from wil_campaign.orchestrator.run.stages.synchronisation import Synchronisation
from wil_campaign.orchestrator.state.liftoff_detector import LiftoffDetector
from wil_campaign.orchestrator.state.run_state import RunState

# A pair of PX4 in SIH (main of August 2025) from 0.9 s before the takeoff command on: seconds,
# height and climb by their estimates, which sink here and rise there. Both lifted at 9.9 s.
SINKS = (
    (5.8, -0.14, -0.02), (6.0, -0.14, 0.02), (6.3, -0.13, 0.07), (6.7, -0.12, 0.08),
    (7.2, -0.16, -0.03), (7.7, -0.21, -0.15), (8.2, -0.29, -0.09), (8.8, -0.34, -0.10),
    (9.3, -0.36, -0.06), (9.7, -0.39, 0.05), (9.9, -0.35, 0.20), (10.2, -0.26, 0.40),
    (10.4, -0.13, 0.60), (10.6, 0.03, 0.65), (10.9, 0.20, 0.54), (11.1, 0.31, 0.47),
)  # fmt: skip
RISES = (
    (5.8, 0.16, 0.18), (6.0, 0.19, 0.15), (6.3, 0.21, 0.12), (6.7, 0.21, 0.06),
    (7.2, 0.23, 0.10), (7.7, 0.28, 0.22), (7.9, 0.33, 0.21), (8.2, 0.37, 0.27),
    (8.4, 0.41, 0.22), (8.8, 0.41, 0.10), (9.1, 0.38, 0.00), (9.5, 0.36, 0.04),
    (9.7, 0.37, 0.03), (9.9, 0.40, 0.20), (10.2, 0.45, 0.33), (10.4, 0.49, 0.31),
    (10.6, 0.55, 0.35), (10.9, 0.63, 0.34), (11.1, 0.67, 0.30), (11.3, 0.69, 0.18),
)  # fmt: skip


def lifted(*samples: tuple[float, float, float]) -> float | None:
    liftoff = LiftoffDetector()
    for t_s, height_m, climb_m_s in samples:
        liftoff.observe(t_s, height_m=height_m, climb_m_s=climb_m_s)
    return liftoff.liftoff_s


@pytest.mark.parametrize("samples", [SINKS, RISES])
def test_a_height_that_drifts_on_the_ground_is_no_lift(
    samples: tuple[tuple[float, float, float], ...],
) -> None:
    assert lifted(*samples) == 9.9


def test_drift_of_an_estimate_before_the_takeoff_is_no_lift() -> None:
    run_state, seconds = RunState(time=lambda: 5.0), count(0.0, 0.5)
    sync = Synchronisation(setup=cast("Any", None), run_state=run_state)
    real, twin = (
        SimpleNamespace(name=name, liftoff=LiftoffDetector()) for name in ("real", "twin")
    )
    sync.attach(cast("Any", (real, twin)))
    for t_s, height_m in zip(seconds, (0.0, 0.2, 0.4, 0.4), strict=False):
        real.liftoff.observe(t_s, height_m=height_m, climb_m_s=0.4)
    assert real.liftoff.liftoff_s == 0.0
    run_state.enter("takeoff")
    for one, began_s in ((real, 7.0), (twin, 7.25)):
        for step in range(4):
            one.liftoff.observe(began_s + step / 2, height_m=0.4 + step / 2, climb_m_s=1.0)
    assert sync.result().takeoff_skew_s == 0.25


def test_a_standing_vehicle_has_no_lift() -> None:
    assert lifted((0.0, 0.0, 0.3), (0.4, 0.09, 0.3), (1.5, 0.08, 0.0), (3.0, 0.05, 0.0)) is None


def test_a_vehicle_that_climbs_slowly_lifted_when_it_stayed_above_the_ground() -> None:
    slow = [(0.1 * step, 0.015 * step, 0.15) for step in range(80)]
    found = lifted((0.0, 0.12, 0.0), (0.05, 0.05, 0.0), *slow)
    assert found is not None
    assert 0.6 < found < 0.8
