"""PX4's failsafes, without a body."""

from vehicles.embedded.autopilot.flight.parameter_table import load_parameters
from vehicles.embedded.autopilot.px4.px4 import Px4
from vehicles.embedded.autopilot.px4.px4_failsafes import Action, Decision, Failsafes, View

SOUND = View(
    t_s=100.0,
    offboard=False,
    landing=False,
    setpoint_age_s=0.0,
    gcs_age_s=0.2,
    battery=1.0,
    outside_fence=False,
)


def failsafes(**parameters: float) -> Failsafes:
    overrides = {"COM_FAIL_ACT_T": 0.0, **parameters}
    return Failsafes(load_parameters(Px4.parameter_file, bytewise=True, overrides=overrides))


def test_a_lost_link_does_not_end_a_landing_that_the_user_commanded() -> None:
    """dll_loss_ignored_land of Failsafe::checkStateAndMode."""
    lost = SOUND._replace(gcs_age_s=60.0)
    found = failsafes(NAV_DLL_ACT=2)
    assert found.check(lost._replace(landing=True)) is None
    assert found.check(lost) == Decision("link", Action.RETURN)
    assert found.check(lost._replace(landing=True)) is None
    assert found.check(lost) == Decision("link", Action.RETURN)
