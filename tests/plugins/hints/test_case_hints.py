"""What is valid and probably not meant is warned of."""

from pathlib import Path
from typing import Any, get_args

import pytest

from tests.campaigns.checks.test_case_warnings import EXISTS, INTRUDER
from tests.vehicles.embedded.physics.test_parts import AIRFRAME_NUMBERS
from wil_campaign.safety.model.samples import ModeName
from wil_campaign.vehicles.embedded.profile import load_profile

NOT_MIXED = "no combination mixes in 'intruder', which exists in the virtual world only"
BODY = "{width_m: 0.6, height_m: 0.2}"
POSITION = "position: {north_m: 2, east_m: 0, up_m: 1.2}"


def warned(files: Any) -> list[str]:
    """Return the warnings of the campaign, without the folder."""
    return [warning.headline.removeprefix(f"{files.folder}/") for warning in files.load().warnings]


def test_a_vehicle_wider_than_the_usual_body_is_warned_of(files: Any) -> None:
    nominal = (Path(load_profile.__code__.co_filename).parent / "profiles/nominal.yaml").read_text()
    airframe = "".join(f"  {key}: {value}\n" for key, value in AIRFRAME_NUMBERS.items())
    (files.folder / "mine.yaml").write_text(f"{nominal}airframe:\n{airframe}")
    files.change("    profile: cage\n", "    profile: mine.yaml\n")
    (told,) = warned(files)
    said = "vehicles.real has no body: 0.3 m is judged, but its motors alone span 0.32 m"
    assert told.endswith(said)
    files.change("    profile: mine.yaml\n", f"    profile: mine.yaml\n    body: {BODY}\n")
    files.change("inner_size_m: 0.5", "inner_size_m: 0.7")
    assert warned(files) == []


@pytest.mark.parametrize(
    ("params", "names"),
    [
        ("{MPC_THR_HOVER: 0.4, MPC_XY_P: 0.9}", ["MPC_THR_HOVER"]),
        ("{RTL_TYPE: 0}", ["RTL_TYPE"]),
    ],
)
def test_a_parameter_without_effect_is_named(files: Any, params: str, names: list[str]) -> None:
    files.change("    profile: cage\n", f"    profile: cage\n    params: {params}\n")
    found = [one.partition(": the embedded px4 carries ")[2] for one in warned(files)]
    assert found == [f"'{name}', and nothing acts on it" for name in names]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("east_m: [-2, 2]", "east_m: [-2000, 2000]", "the fence is 4000 m wide, and the room 6 m"),
        ("collision: {}", "collision: {exclude: [cage, gate]}", "it cannot fail"),
        ("limit_s: 40", "limit_s: 40}\n  late: {use: time_limit, limit_s: 90", "it cannot fail"),
        (
            "limit_s: 40",
            "limit_s: 40}\n  late: {use: time_limit, from: land, to: landed, limit_s: 60",
            "sync.landing_timeout_s ends the stage after 60 s: it cannot fail",
        ),
        (
            "collision: {}",
            "altitude: {max_m: 2, from: done, to: land}",
            "in mode sim the window of 'altitude' closes when it opens: it cannot fail",
        ),
        *(
            ("collision: {}", f"{oracle}\n  collision: {{}}", said)
            for oracle, said in (
                ("battery: {min_percent: 0}", "no battery is charged to less than 0 %"),
                ("distance: {object: gate, min_m: 0}", "nothing is less than 0: it cannot fail"),
                ("speed: {min_m_s: 0}", "nothing is less than 0: it cannot fail"),
                ("speed: {max_m_s: 2.0e+3}", "than any drone flies: no flight decides it"),
                (
                    "height: {use: stl, stl: always (up_m <= up_m)}",
                    "holds for every value there is",
                ),
                ("altitude: {min_m: -2.0e+5}", "than any drone flies: no flight decides it"),
                ("encounter: {object: gate, within_m: 4.0e+15}", "no flight decides it"),
                (
                    "time: {use: time_limit, limit_s: 2147483648, from: takeoff, to: landed}",
                    "2.14748e+09 is farther, faster or longer than any drone flies",
                ),
                ("link: {max_gap_s: 150}", "end each flight after 150 s: it cannot fail"),
                ("estimator: {max_unsound_s: 150}", "end each flight after 150 s: it cannot fail"),
                ("attitude: {max_tilt_deg: 180}", "no attitude is beyond 180 degrees"),
                ("attitude: {max_pitch_deg: 90}", "no attitude is beyond 90 degrees"),
                (
                    f"modes: {{allowed: [{', '.join(get_args(ModeName))}]}}",
                    "names every mode: it cannot fail",
                ),
                ("altitude: {max_m: 2.5}", "the ceiling is 2.5 m up: it cannot fail below that"),
                (
                    "area: {keep: {box: {north_m: [-99, 99], east_m: [-1, 1], up_m: [0, 2]}}}",
                    "the area is 198 m wide, and the room 6 m: it cannot fail",
                ),
            )
        ),
    ],
)
def test_a_probable_mistake_is_warned_of(files: Any, old: str, new: str, said: str) -> None:
    if "late" in new or "150" in new:
        files.change("seed: 7\n", "seed: 7\nsync: {goal_timeout_s: 60}\n")
    files.change(old, new)
    found = warned(files)
    assert any(said in one for one in found), found
    assert all(one.startswith("campaign.yaml:") for one in found)


@pytest.mark.parametrize(
    "oracle",
    [
        "battery: {min_percent: 1}",
        "link: {max_gap_s: 149}",
        "attitude: {max_tilt_deg: 179, max_roll_deg: 179, max_pitch_deg: 89}",
        "modes: {allowed: [hold, takeoff, guided, land, rtl, mission, pilot]}",
        f"modes: {{allowed: [{', '.join(get_args(ModeName))}], max_changes: 1}}",
        "altitude: {max_m: 2.4}",
        "area: {keep: {box: {north_m: [-40, 40], east_m: [-1, 1], up_m: [0, 2]}}}",
    ],
)
def test_limits_that_a_flight_can_exceed_are_not_warned_of(files: Any, oracle: str) -> None:
    files.change("seed: 7\n", "seed: 7\nsync: {goal_timeout_s: 60}\n")
    files.change("collision: {}", f"{oracle}\n  collision: {{}}")
    assert warned(files) == []


@pytest.mark.parametrize(
    ("tolerance_m", "said"),
    [("30", "the goal is 2 m from the hover: it cannot fail"), ("0.3", None)],
)
def test_a_goal_that_nearly_any_flight_reaches_is_warned_of(
    files: Any, tolerance_m: str, said: str | None
) -> None:
    files.change("gates: [gate]", POSITION)
    files.change("  reached: {}\n", f"  reached_position: {{tolerance_m: {tolerance_m}}}\n")
    found = warned(files)
    assert found == [] if said is None else any(said in one for one in found)


def test_a_control_that_its_oracle_cannot_fail_is_warned_of(files: Any) -> None:
    files.append(
        "sync: {goal_timeout_s: 60}\n"
        "controls:\n"
        "  slow:\n"
        "    set: {oracles.time_limit.limit_s: 90}\n"
        "    expect: {oracle: time_limit}\n"
    )
    own, found = warned(files)
    assert found.startswith("campaign.yaml:38:39: ")
    assert "sync.goal_timeout_s ends the stage after 60 s: it cannot fail" in found
    assert own.startswith(
        "campaign.yaml:38:11: changes 'time_limit', which then fails by a limit of"
    )


def test_a_sensor_that_shows_the_world_and_is_not_mixed_is_warned_of(files: Any) -> None:
    files.change("mocap\n    sensors:\n", "mocap\n    sensors:\n      scan: {type: lidar}\n")
    text = "mixes no 'scan' for 'real': it is the real one, without what is virtual"
    assert warned(files) == [f"recipe.yaml:3:1: {text}"]
    files.change("modes: [sim, wil]", "modes: [sim]")
    files.change("{large: {sim: 3/3, wil: 2/3}}", "{large: {sim: 3/3}}")
    assert warned(files) == []


@pytest.mark.parametrize(
    ("oracle", "why"),
    [
        ("", ""),
        ("  near: {use: distance, object: intruder, min_m: 0.1}\n", "named"),
        ('  near: {stl: "always (distance_intruder_m > 0.1)"}\n', "named"),
        ('  near: {stl: "always (distance_intruder_m > 0.1)", required: false}\n', ""),
    ],
)
def test_a_virtual_object_that_a_recipe_leaves_out_by_name_is_warned_of(
    files: Any, oracle: str, why: str
) -> None:
    files.append(INTRUDER, file="world.yaml")
    files.change("    color: orange\n", "    color: orange\n" + EXISTS, file="world.yaml")
    files.change("  reached: {}\n", "  reached: {}\n" + oracle)
    why = ", and the goal or a required oracle names it" if why else ""
    said = f"{NOT_MIXED}{why} (list the intended objects in `shows`)"
    assert warned(files) == [f"recipe.yaml:5:5: {said}"]
    assert files.load().caveats == (), "whether it comes into view is seen in flight"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[gate]", "[gate, intruder]"),
        ("[{isolate_objects: [gate]}]", "[{isolate_color: {name: orange}}]"),
        ("real]}}\n", "real]}}\n    shows: [gate]\n"),
    ],
)
def test_a_recipe_that_mixes_all_or_says_what_it_shows_is_not_warned_of(
    files: Any, old: str, new: str
) -> None:
    files.append(INTRUDER, file="world.yaml")
    files.change("    color: orange\n", "    color: orange\n" + EXISTS, file="world.yaml")
    files.change(old, new, file="recipe.yaml")
    assert warned(files) == []


def test_a_recipe_that_isolates_only_what_both_worlds_have_is_warned_of(files: Any) -> None:
    """It isolated no virtual object at all, and nothing was said."""
    files.append(INTRUDER, file="world.yaml")
    files.change(
        "    color: orange\n",
        "    color: orange\n    exists_in: {sim: both, wil: both, real: both}\n",
        "world.yaml",
    )
    assert warned(files) == [f"recipe.yaml:5:5: {NOT_MIXED} (list the intended objects in `shows`)"]


def test_an_object_of_the_goal_that_shows_leaves_out_is_warned_of(files: Any) -> None:
    files.append(INTRUDER, file="world.yaml")
    files.change("    color: orange\n", "    color: orange\n" + EXISTS, file="world.yaml")
    files.change("[gate]", "[gate, intruder]", file="recipe.yaml")
    files.append("    shows: [intruder]\n", file="recipe.yaml")
    text = "`shows` leaves out 'gate', which the goal or a required oracle names"
    assert [one.partition(": ")[2] for one in warned(files)] == [
        f"{text}: its images are not checked"
    ]
    files.change("shows: [intruder]", "shows: [gate]", file="recipe.yaml")
    assert warned(files) == []


def test_objects_that_stand_nowhere_are_warned_of(files: Any) -> None:
    world = files.folder / "world.yaml"
    text = world.read_text()
    nowhere = "    exists_in: {sim: W, wil: W}\n    shape:"
    world.write_text(text.replace("    shape:", nowhere))
    files.change("goal: {altitude_m: 1.2, gates: [gate]}", "goal: {altitude_m: 1.2}")
    files.change("  reached: {}\n", "")
    assert [one.partition(": ")[2] for one in warned(files)] == [
        "isolates 'gate' alone, and Wv in mode wil has nothing of it: nothing is mixed in",
        *(
            f"in mode {mode} no object of the world exists in Wv: no contact is possible "
            "(see exists_in)"
            for mode in ("sim", "wil")
        ),
    ]
