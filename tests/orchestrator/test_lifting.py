"""When a vehicle lifted: heights as real autopilots gave them, which drift on the ground."""

from orchestrator.run.lifting import Lift

# PX4 in SIH (main of August 2025) after arming: seconds, height and climb by its estimate.
# In truth it stood until 13.0 s.
PX4_SIH = (
    (6.8, 0.15, 0.04), (7.8, 0.16, 0.03), (8.8, 0.17, 0.13), (9.8, 0.26, 0.07), (10.8, 0.22, 0.03),
    (11.8, 0.29, 0.02), (12.8, 0.20, -0.06), (13.2, 0.23, 0.21), (13.4, 0.31, 0.42),
    (13.8, 0.49, 0.45), (14.0, 0.57, 0.40), (14.8, 0.83, 0.11), (15.8, 0.95, 0.20),
)  # fmt: skip


def lifted(*samples: tuple[float, float, float]) -> float | None:
    lift = Lift()
    for t_s, height_m, climb_m_s in samples:
        lift.take(t_s, height_m=height_m, climb_m_s=climb_m_s)
    return lift.lifted_s


def test_a_height_that_drifts_on_the_ground_is_no_lift() -> None:
    assert lifted(*PX4_SIH) == 13.2


def test_a_gust_of_an_estimate_is_no_lift() -> None:
    assert lifted((0.0, 0.0, 0.3), (0.4, 0.09, 0.3), (0.5, 0.08, 0.0)) is None


def test_who_climbs_slowly_lifted_when_it_stayed_above_the_ground() -> None:
    slow = [(0.1 * step, 0.015 * step, 0.15) for step in range(80)]
    found = lifted((0.0, 0.12, 0.0), (0.05, 0.05, 0.0), *slow)
    assert found is not None
    assert 0.6 < found < 0.8
