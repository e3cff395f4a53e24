"""Attached actors of a campaign file: what flies in which mode, and what is refused."""

import math
from pathlib import Path

import pytest

from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, load_campaign
from wil_campaign.campaigns.setup.encounters import actor_encounters
from wil_campaign.foundation.files.documents import BadInput

AVOID = Path(__file__).parents[3] / "campaigns" / "avoid.yaml"
BOX = "box: {north_m: [%g, %g], east_m: [-1.5, 1.5], up_m: [-0.5, 2.3]}"
FENCE = "geofence: {" + BOX % (-1.5, 3.5) + "}"
ATTACHED = "actors={intruder: {link: 'udpin://0.0.0.0:14560', autopilot: px4, %s}}"
HERE = ATTACHED % FENCE
EMBEDDED = ATTACHED % f"{FENCE}, virtual: embedded"
FAR = ATTACHED % f"{FENCE}, virtual: {{place: {{north_m: 30, east_m: 2, yaw_deg: 90}}}}"
NEAR = ATTACHED % f"{FENCE}, virtual: {{place: {{north_m: 4, yaw_deg: 180}}}}"
REAL = ("vehicles.real.link=udpin://0.0.0.0:14550", "vehicles.real.pose_source=mavlink")
ANSWERED = "preflight.override={separation: A. Pilot}"


def campaign(*sets: str, mode: str = "real") -> Campaign:
    one_case = ("cases={fast: {}}", f"accept={{fast: {{{mode}: 5/5}}}}", "controls={}")
    given = (*one_case, f"modes=[{mode}]", *sets)
    return load_campaign(AVOID, ExpansionOptions(sets=given, loads_code=False))


def problems(*sets: str, mode: str = "real") -> str:
    with pytest.raises(BadInput) as caught:
        campaign(*sets, mode=mode)
    return "\n".join(map(str, caught.value.problems))


@pytest.mark.parametrize("mode", ["sim", "wil"])
def test_an_attached_actor_with_a_virtual_object_flies_only_at_a_given_place(
    mode: str,
) -> None:
    said = problems(HERE, mode=mode)
    assert f"in mode {mode} 'intruder' is virtual, but an attached vehicle is physical" in said
    assert "virtual: embedded" in said


@pytest.mark.parametrize(("mode", "kind"), [("sim", "embedded"), ("real", "attached")])
def test_virtual_embedded_is_attached_only_where_it_is_physical(mode: str, kind: str) -> None:
    (actor,) = campaign(EMBEDDED, mode=mode).setups["fast"].actors_in(mode)  # type: ignore[arg-type]
    assert (actor.kind, actor.params, actor.place) == (kind, {}, None)
    assert actor.pose_source == {"embedded": "simulator", "attached": "mavlink"}[kind]


def test_an_attached_actor_may_fly_without_gps() -> None:
    (actor,) = campaign(ATTACHED % f"{FENCE}, gps: false").setups["fast"].actors_in("real")
    assert not actor.has_gps
    said = problems("actors={intruder: {link: embedded, autopilot: px4, gps: false}}")
    assert "the embedded vehicle flies by GPS; remove it" in said


def test_an_actor_at_another_place_starts_where_its_object_does() -> None:
    setup = campaign(FAR, *REAL, mode="wil").setups["fast"]
    (actor,) = setup.actors_in("wil")
    assert actor.kind == "attached"
    assert actor.start.position_ned_m == pytest.approx((2.5, 0.0, -0.05))
    assert actor.standing_pose.position_ned_m == (30.0, 2.0, 0.0)
    (one,) = actor_encounters(setup, "wil")
    assert one.stated_m == pytest.approx(math.hypot(30.0, 2.0))
    # It heads east where its object heads south: its fence is turned by that, and moved with it.
    assert one.apart_m == pytest.approx(30.0 - 1.5 - 2.0)


@pytest.mark.parametrize("override", [(), (ANSWERED,)])
def test_no_override_allows_a_place_that_can_touch_the_real_vehicle(
    override: tuple[str, ...],
) -> None:
    said = problems(NEAR, *REAL, *override, mode="wil")
    assert "the two can touch" in said
    assert "by another `place`" in said


def test_two_attached_vehicles_that_can_touch_need_an_override_with_a_name() -> None:
    said = problems(HERE, *REAL)
    assert "this fence is 0.00 m from that of 'real', also attached: the two can touch" in said
    assert "preflight.override: {separation: NAME}" in said
    assert campaign(HERE, *REAL, ANSWERED).setups["fast"].preflight.override
    # Beside a real vehicle that is embedded there is nothing to touch.
    assert campaign(HERE)
    # Height separates nobody: what lands comes down.
    above = HERE.replace("up_m: [-0.5, 2.3]", "up_m: [-0.5, 9]")
    assert "the two can touch" in problems(above, *REAL)


def test_a_missing_fence_of_the_other_vehicle_is_reported() -> None:
    fenceless = "geofence={twin: {box: {north_m: [-1, 2], east_m: [-1, 1], up_m: [-1, 2]}}}"
    said = problems(HERE, *REAL, ANSWERED, fenceless, "oracles.geofence.required=false")
    assert "has no geofence: nothing keeps the two apart" in said


@pytest.mark.parametrize(
    ("sets", "said"),
    [
        ((ATTACHED % "profile: nominal",), "needs a `geofence` of its own"),
        ((HERE.replace("-1.5, 3.5", "-0.5, 3.5"),), "'intruder' has waypoint 1 0.30 m outside of"),
        ((HERE.replace("-1.5, 3.5", "-1.5, 2.2"),), "'intruder' starts 0.30 m outside of its"),
        (
            (ATTACHED % "geofence: {file: f.plan, up_m: [0, 2]}",),
            "an actor's fence is written here",
        ),
        (("actors={intruder: {link: embedded, autopilot: px4, virtual: embedded}}",), "remove it"),
        (("actors={intruder: {link: embedded, autopilot: px4, pose_source: mavlink}}",), "remove"),
        ((HERE, "actors.intruder.link=memory://x"), "memory:// connects to nothing outside"),
        (("actors={intruder: {link: {launch: px4, build: nowhere}, autopilot: px4}}",), "nowhere"),
        (
            ("actors={intruder: {link: {launch: px4, build: b}, autopilot: ardupilot}}",),
            "the link launches px4",
        ),
        ((HERE, *REAL, ANSWERED, "vehicles.real.link=udpin://0.0.0.0:14560"), "are both on"),
        (
            (HERE, *REAL, ANSWERED, "between_runs={do: fly_back}"),
            "a person has to return the attached actor",
        ),
    ],
)
def test_an_unsafe_or_meaningless_attached_actor_is_refused(
    sets: tuple[str, ...], said: str
) -> None:
    assert said in problems(*sets)
