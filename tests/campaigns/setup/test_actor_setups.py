"""Actors of a campaign file: which objects a vehicle can fly as, and what is said of others."""

from pathlib import Path

import pytest

from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.campaigns.setup.actor_setups import ActorSetup
from wil_campaign.foundation.files.documents import BadInput

AVOID = Path(__file__).parents[3] / "campaigns" / "avoid.yaml"
FLOWN = "actors={intruder: {link: embedded, autopilot: px4}}"
MOTION = "world.objects.intruder.motion"


def setup(*sets: str) -> ActorSetup:
    options = ExpansionOptions(
        cases=("fast",), modes=("sim",), sets=(FLOWN, *sets, "controls={}"), loads_code=False
    )
    return load_campaign(AVOID, options).runs[0].setup().actors["intruder"]


def test_an_actor_starts_where_its_object_stands_and_has_its_motion() -> None:
    actor = setup()
    assert actor.start.position_ned_m == pytest.approx((2.5, 0.0, -0.05))
    assert actor.motion.waypoints[1].speed_m_s == 1.0
    assert actor.system_id == 3


@pytest.mark.parametrize(
    ("sets", "said"),
    [
        (("actors={intrudr: {link: embedded, autopilot: px4}}",), "the world has no object"),
        (("actors={cage: {link: embedded, autopilot: px4}}",), "has no motion in the world file"),
        (("actors={real: {link: embedded, autopilot: px4}}",), "is a vehicle of the pair"),
        (("actors.intruder.system_id=2",), "'twin' also has system id 2"),
        (("actors.intruder.params={NO_SUCH: 1}",), "has no parameter 'NO_SUCH'"),
        (("actors.intruder.profile=nowhere",), "nowhere"),
        (("actors.intruder.telemetry.max_gap_s=1",), "has no effect on an actor; write max_silen"),
        ((f"{MOTION}.loop=true",), "repeats for ever"),
        ((f"{MOTION}.waypoints.0.north_m=2.0",), "is not above its start"),
        ((f"{MOTION}.waypoints.0.up_m=0.2",), "is not above its start"),
    ],
)
def test_an_actor_that_no_vehicle_can_fly_is_refused(sets: tuple[str, ...], said: str) -> None:
    with pytest.raises(BadInput) as caught:
        setup(*sets)
    assert any(said in str(problem) for problem in caught.value.problems)


def test_a_parameter_of_an_actor_without_effect_is_warned_of() -> None:
    sets = (FLOWN, "actors.intruder.params={RTL_TYPE: 1, MPC_XY_P: 0.9}", "controls={}")
    options = ExpansionOptions(cases=("fast",), modes=("sim",), sets=sets, loads_code=False)
    texts = [str(warning) for warning in load_campaign(AVOID, options).warnings]
    assert sum("carries 'RTL_TYPE', and nothing acts on it" in text for text in texts) == 1
    assert not any("carries 'MPC_XY_P'" in text for text in texts)
