"""Preflight's checks by values alone: what is let through, what is refused, in which words."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.preflight import (
    PreflightItem,
    at_least_item,
    at_most_item,
    distance_item,
    earth_item,
    faults_item,
    gps_items,
    ground_truth_item,
    home_item,
    items_with_overrides,
    pair_item,
    refused_items_text,
    separation_item,
)
from wil_campaign.vehicles.autopilots.failsafes import AutopilotFailsafes
from wil_campaign.vehicles.autopilots.registry import autopilot_named


def failsafes(autopilot: str) -> AutopilotFailsafes:
    return autopilot_named(autopilot).failsafes


FENCE = Fence.box(north_m=(-1, 4), east_m=(-2, 2), up_m=(-0.5, 2.5))
SOUND: dict[str, dict[str, float]] = {
    "ardupilot": {
        "FS_GCS_ENABLE": 5,
        "FS_GCS_TIMEOUT": 5.0,
        "FS_OPTIONS": 0,
        "MAV_GCS_SYSID": 245,
    },
    "px4": {"NAV_DLL_ACT": 3, "COM_DL_LOSS_T": 10, "COM_OBL_RC_ACT": 4, "COM_OF_LOSS_T": 1.0},
}


@pytest.mark.parametrize(
    ("item", "outcome", "text"),
    [
        (at_least_item("battery", "real", 0.8, 0.3, unit="", what="its charge"), "ok", ""),
        (
            at_least_item("battery", "real", 0.2, 0.3, unit="", what="its charge"),
            "refused",
            "its charge is 0.2, and at least 0.3 is required",
        ),
        (
            at_least_item("battery", "real", None, 0.3, unit="", what="its charge"),
            "refused",
            "its charge is not known",
        ),
        (
            at_most_item("clock", "real", math.inf, 0.25, unit="s", what="its error"),
            "refused",
            "its error is not known",
        ),
        (
            at_most_item("clock", "real", 0.3, 0.25, unit="s", what="its error"),
            "refused",
            "its error is 0.3 s, and at most 0.25 s is allowed",
        ),
        (
            at_least_item("disk", "", 1996.4, 2000.0, unit="MB", what="free space"),
            "refused",
            "free space is 1996 MB, and at least 2000 MB is required",
        ),
        (
            at_most_item("return_altitude", "real", 15.004, 15.0, unit="m", what="it"),
            "refused",
            "it is 15.004 m, and at most 15 m is allowed",
        ),
        (faults_item("estimator", "twin", ()), "ok", ""),
        (
            faults_item("estimator", "twin", ("no gps", "no height")),
            "refused",
            "no gps; no heig",
        ),
        (home_item("real", FENCE, (0, 0, 0), 0.3), "ok", ""),
        (
            home_item("real", FENCE, (0, 0, 0), 0.6),
            "refused",
            "it is 0.50 m from the fence's floor, nearer than 0.6 m",
        ),
        (
            home_item("real", FENCE, (-1.5, 0, -1), 0.0),
            "refused",
            "it is 0.50 m outside of the fence's south side",
        ),
        (home_item("real", FENCE, None, 0.0), "refused", "its position is not known"),
        (pair_item((0, 0, 0), (0.3, 0.4, 0), 0.5), "ok", ""),
        (pair_item((0, 0, 0), (0.3, 0.41, 0), 0.5), "refused", "and at most 0.5 m is allowed"),
        (pair_item((0, 0, 0), None, 0.5), "refused", "is not known"),
        (separation_item("ghost", "real", 0.5, 0.5), "ok", ""),
        (separation_item("ghost", "real", 0.4, 0.5), "refused", "so that they can touch"),
        (distance_item("ghost", "real", 24.0, stated_m=28.0), "ok", ""),
        (
            distance_item("ghost", "real", 2.5, stated_m=30.0),
            "refused",
            "it is 2.5 m from real by both receivers, and 30.0 m by the campaign",
        ),
        (distance_item("ghost", "real", None, stated_m=30.0), "refused", "is not known"),
        (distance_item("ghost", "real", math.nan, stated_m=30.0), "refused", "is not known"),
    ],
)
def test_each_check_has_its_outcome_and_text(item: PreflightItem, outcome: str, text: str) -> None:
    assert item.outcome == outcome
    assert text in item.text
    assert bool(refused_items_text([item])) is (outcome == "refused")


def test_an_override_names_who_takes_it_on_and_covers_nothing_else() -> None:
    items = (
        faults_item("failsafe", "real", ["off"]),
        faults_item("estimator", "real", ["no height"]),
        faults_item("failsafe", "twin", ()),
    )
    settled_items = items_with_overrides(items, {"failsafe": "J. Doe"})
    assert [(one.outcome, one.by) for one in settled_items] == [
        ("overridden", "J. Doe"),
        ("refused", ""),
        ("ok", ""),
    ]
    assert refused_items_text(settled_items) == "real estimator: no height"
    assert str(settled_items[0]) == "real failsafe: off (overridden by J. Doe)"


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_wanted_values_of_failsafes_are_sound(autopilot: str) -> None:
    rules = failsafes(autopilot).rules
    assert all(rule.wanted is None or rule.holds(rule.wanted) for rule in rules)
    assert list(failsafes(autopilot).unsound(SOUND[autopilot])) == []
    for name in SOUND[autopilot]:
        less = {key: value for key, value in SOUND[autopilot].items() if key != name}
        (said,) = failsafes(autopilot).unsound(less)
        assert said == f"{name} is not known"


@pytest.mark.parametrize(
    ("autopilot", "name", "value", "said"),
    [
        ("ardupilot", "FS_GCS_ENABLE", 0, "FS_GCS_ENABLE is 0: on link loss it would hover until"),
        ("ardupilot", "FS_GCS_ENABLE", 7, "FS_GCS_ENABLE is 7: on link loss it would hover until"),
        ("ardupilot", "FS_GCS_TIMEOUT", 60, "FS_GCS_TIMEOUT is 60: it would take too long"),
        ("ardupilot", "FS_OPTIONS", 16, "FS_OPTIONS is 16: it would ignore a link loss in BRAKE"),
        ("ardupilot", "FS_OPTIONS", 27, "FS_OPTIONS is 27: it would ignore a link loss in BRAKE"),
        ("ardupilot", "FS_OPTIONS", math.nan, "FS_OPTIONS is nan: it would ignore"),
        ("ardupilot", "MAV_GCS_SYSID", 255, "MAV_GCS_SYSID is 255: it expects another ground"),
        ("ardupilot", "FS_EKF_ACTION", 2, "FS_EKF_ACTION is 2: without a position it would not"),
        ("px4", "COM_DLL_EXCEPT", 2, "COM_DLL_EXCEPT is 2: it would ignore a link loss in Hold"),
        ("px4", "COM_DLL_EXCEPT", 7, "COM_DLL_EXCEPT is 7: it would ignore a link loss in Hold"),
        ("px4", "NAV_DLL_ACT", 0, "NAV_DLL_ACT is 0: on link loss it would not"),
        ("px4", "NAV_DLL_ACT", 1, "NAV_DLL_ACT is 1: on link loss it would not"),
        ("px4", "NAV_DLL_ACT", 5, "NAV_DLL_ACT is 5: on link loss it would not"),
        ("px4", "COM_OBL_RC_ACT", 7, "COM_OBL_RC_ACT is 7: it would fall"),
        ("px4", "COM_OF_LOSS_T", 20, "COM_OF_LOSS_T is 20: it would fly on for too long"),
    ],
)
def test_an_unsound_value_of_a_failsafe_is_named(
    autopilot: str, name: str, value: float, said: str
) -> None:
    values = {**SOUND[autopilot], name: value}
    (found,) = failsafes(autopilot).unsound(values)
    assert found.startswith(said)


@pytest.mark.parametrize(
    ("autopilot", "action", "end"),
    [
        ("ardupilot", {"FS_GCS_ENABLE": 1}, {"RTL_ALT_FINAL": 200}),
        ("ardupilot", {"FS_GCS_ENABLE": 3}, {"RTL_ALT_FINAL_M": 2}),
        ("px4", {"NAV_DLL_ACT": 2}, {"RTL_LAND_DELAY": -1}),
    ],
)
def test_a_return_that_hovers_at_its_end_is_no_landing(
    autopilot: str, action: dict[str, float], end: dict[str, float]
) -> None:
    sound = SOUND[autopilot]
    assert list(failsafes(autopilot).unsound({**sound, **end})) == []
    assert list(failsafes(autopilot).unsound({**sound, **action})) == []
    (found,) = failsafes(autopilot).unsound({**sound, **action, **end})
    assert "it would return, and hover there" in found


@pytest.mark.parametrize(
    ("name", "value", "instead"),
    [
        ("FS_OPTIONS", 16, 0),
        ("FS_OPTIONS", 27, 11),
        ("FS_OPTIONS", 8, None),
        ("FS_OPTIONS", math.nan, None),
        ("FS_GCS_ENABLE", 1, 5),
        ("FS_GCS_ENABLE", 5, None),
        ("FS_GCS_TIMEOUT", 60, None),
    ],
)
def test_an_unsound_value_is_replaced_by_a_sound_one(
    name: str, value: float, instead: int | None
) -> None:
    (rule,) = (one for one in failsafes("ardupilot").rules if name in one.names)
    assert rule.wanted_instead(value) == instead
    assert instead is None or rule.holds(instead)


def test_older_firmware_has_older_names_and_units() -> None:
    older = {"FS_GCS_ENABLE": 5, "FS_GCS_TIMEOUT": 5.0, "FS_OPTIONS": 0, "SYSID_MYGCS": 245}
    assert list(failsafes("ardupilot").unsound(older)) == []
    assert failsafes("ardupilot").return_altitude_m({"RTL_ALT": 1500}) == 15.0
    assert failsafes("ardupilot").return_altitude_m({"RTL_ALT_M": 15}) == 15.0
    assert failsafes("px4").return_altitude_m({"RTL_RETURN_ALT": 60}) == 60.0
    assert failsafes("px4").return_altitude_m({}) is None


@given(st.floats(), st.floats(0, 1e3))
def test_no_number_of_an_item_is_not_finite(actual: float, limit: float) -> None:
    for item in (
        at_least_item("battery", "real", actual, limit, unit="", what="it"),
        at_most_item("clock", "real", actual, limit, unit="s", what="it"),
    ):
        assert item.actual is None or math.isfinite(item.actual)
        assert (item.outcome == "ok") is (item.text == "")


@pytest.mark.parametrize("fix", [(3, 9, 1.0), (3, 4, 9.0), (1, 0, None), (0, None, None)])
def test_counts_of_satellites_are_written_as_numbers(
    fix: tuple[int, int | None, float | None],
) -> None:
    for item in gps_items("real", fix, min_satellites=6, max_hdop=2.0):
        assert isinstance(item.actual, float | None)
        assert isinstance(item.limit, float | None)


def test_time_outs_of_a_simulation_are_as_many_times_longer_as_it_is_faster() -> None:
    # PX4's startup script multiplies them; its own clock is as much faster.
    values = {**SOUND["px4"], "COM_DL_LOSS_T": 50.0, "COM_OF_LOSS_T": 5.0}
    assert list(failsafes("px4").unsound(values, pace=5.0)) == []
    (said,) = failsafes("px4").unsound(values)
    assert said.startswith("COM_DL_LOSS_T is 50: ")
    assert len(list(failsafes("px4").unsound({**values, "COM_DL_LOSS_T": 500.0}, pace=5.0))) == 1


@pytest.mark.parametrize(
    ("rate_hz", "refused", "said"),
    [
        (49.0, "", ""),
        (25.0, "an old one was not usable", ""),
        (8.0, "", "the rate of its simulator's SIM_STATE is 8 Hz, and at least 25 Hz is required"),
        (None, "", "its simulator sends no SIM_STATE: is it a simulation?; pose_source: mavlink"),
        (None, "SIM_STATE has no lat_int", "SIM_STATE has no lat_int; pose_source: mavlink"),
    ],
)
def test_a_ground_truth_comes_usable_and_often(
    rate_hz: float | None, refused: str, said: str
) -> None:
    item = ground_truth_item("real", rate_hz, wanted_hz=50.0, message="SIM_STATE", refused=refused)
    assert item.outcome == ("refused" if said else "ok")
    assert item.text.startswith(said)


@pytest.mark.parametrize(
    ("off_m", "turned_deg", "outcome", "said"),
    [
        (4.9, -14.0, "ok", ""),
        (251.0, 0.0, "refused", "it stands 251 m from its start (47.400000, 8.545600 by the"),
        (0.5, 90.0, "refused", "turned by 90 degrees; its fence, which is given in degrees, would"),
        (None, 0.0, "refused", "it stands at an unknown distance from its start"),
    ],
)
def test_a_fence_in_degrees_needs_the_vehicle_where_the_world_has_it(
    off_m: float | None, turned_deg: float, outcome: str, said: str
) -> None:
    item = earth_item("real", off_m, turned_deg, (47.4, 8.5456))
    assert (item.check, item.outcome, item.actual) == ("home", outcome, off_m)
    assert said in item.text
