"""Faults of `oracles`: what is said of each, and where in the file."""

from typing import Any

import pytest

ONE_PLACE = [
    # what stands instead of `collision: {}` ("@" marks the place of the fault), what is said
    ("@colision: {}", "unknown oracle 'colision'; did you mean 'collision'?"),
    ("low: {use: @altitud, max_m: 2}", "unknown oracle 'altitud'; did you mean 'altitude'?"),
    ("altitude: {@max: 2}", "unknown key 'max'; did you mean 'max_m'?"),
    ("altitude: {@max_ft: 7}", "unknown key 'max_ft'; did you mean 'max_m'?"),
    ("speed: {@max_kmh: 7}", "unknown key 'max_kmh'; did you mean 'max_m_s'?"),
    ("altitude: {max_m: @2 m}", "must be a number, is the text '2 m' (a plain number; the key"),
    ("altitude: {max_m: @.nan}", "must be a number, is the text '.nan' (it must be finite)"),
    ("altitude: {min_m: @3, max_m: 2}", "3 is not below max_m"),
    ("modes: {allowed: @[]}", "names no mode"),
    ("altitude: {max_m: 2, from: @start}", "must be takeoff, at_height, goal, done or land, is"),
    ("altitude: {max_m: 2, from: @landed}", "must be takeoff, at_height, goal, done or land, is"),
    ("altitude: {max_m: 2, from: land, to: @goal}", "its window is empty: 'land' does not come"),
    ("altitude: {max_m: 2, required: false, fail_fast: @true}", "an oracle that is not required"),
    ("late: {use: reached, fail_fast: @true}", "its result is only known at the end of its window"),
    ("distance: {object: @gaet, min_m: 1}", "the judged world has no object 'gaet'"),
    ("landed: {@from: goal}", "unknown key 'from'"),
    ("modes: {allowed: [@GUIDED]}", "must be hold, takeoff, guided, land, rtl, mission, pilot or"),
    ("altitude: {max_m: 2, vehicle: @both}", "must be real or twin, is 'both'"),
    ("clear: {stl: 'always[0,30] (@clearence_m >= 0.1)'}", "unknown signal 'clearence_m'; did"),
    ("clear: {stl: 'always (@clearance >= 0.1)'}", "did you mean 'clearance_m'?"),
    ('clear: {stl: "@alway[0,30] (clearance_m >= 0.1)"}', "did you mean 'always'?"),
    ("clear: {stl: always (clearance_m >= @), vehicle: real}", "a signal, a number or '(' is"),
    ("clear: {stl: always (up_m > 0.5 @m)}", "a number has no unit"),
    ("clear: {stl: always (up_m @< speed_m_s)}", "m cannot be compared with m/s"),
    ("clear: {stl: always (@goal_distance_m < 1), required: false}", "unknown signal 'goal_dist"),
    ("clear: {stl: @5}", "must be text, is 5"),
    ("clear: {stl: up_m > 0, @unit: m}", "unknown key 'unit'"),
    (
        "area: {keep: {box: {north_m: @[2, 1], east_m: [0, 1], up_m: [0, 1]}}}",
        "must be [low, high], is [2, 1]",
    ),
]


@pytest.mark.parametrize(("new", "said"), ONE_PLACE)
def test_a_fault_of_an_oracle_is_shown_where_it_is(files: Any, new: str, said: str) -> None:
    files.change("  collision: {}", f"  {new.replace('@', '')}")
    lines = files.path.read_text().splitlines()
    line = next(n for n, text in enumerate(lines, 1) if text.strip() == new.replace("@", ""))
    place = f"campaign.yaml:{line}:{3 + new.index('@')}: "
    faults = files.faults()
    assert all(fault.startswith(place) for fault in faults), faults
    assert said in faults[0]


def test_a_mistake_in_a_formula_of_several_lines_is_found(files: Any) -> None:
    formula = """\
  clear:
    stl: >
      always[0,30] (up_m > 0.5
        and sped_m_s < 3)
"""
    files.change("  collision: {}\n", formula)
    (fault,) = files.faults()
    line = files.path.read_text().splitlines().index("        and sped_m_s < 3)") + 1
    assert fault.startswith(f"campaign.yaml:{line}:13: oracle 'clear': unknown signal 'sped_m_s'")


@pytest.mark.parametrize(
    ("oracle", "at"),
    [
        ("{stl: 'always (distance_guest_m > 1)'}", "31:24"),
        ("{use: distance, object: guest, min_m: 1}", "31:33"),
    ],
)
def test_an_object_that_one_case_takes_away_is_not_called_unknown(
    files: Any, oracle: str, at: str
) -> None:
    guest = "  guest:\n    shape: {box: {size_m: [0.2, 0.2, 0.2]}}\n"
    files.append(guest + "    pose: {north_m: 2, east_m: 1, up_m: 0.5}\n", "world.yaml")
    files.change("  collision: {}", f"  near: {oracle}\n  collision: {{}}")
    assert files.load().runs
    nowhere = "{sim: none, wil: none, real: none}"
    files.change("  small:", f"  empty: {{world.objects.guest.exists_in: {nowhere}}}\n  small:")
    text = files.path.read_text().splitlines()
    line = next(n for n, one in enumerate(text, 1) if "empty:" in one)
    assert files.faults() == [
        f"campaign.yaml:{at}: case empty: oracle 'near': 'guest' is not in Wv in mode {mode} "
        f"(see its exists_in, campaign.yaml:{line})"
        for mode in ("sim", "wil")
    ]


def test_a_formula_about_both_vehicles_is_omitted_where_one_flies_alone(files: Any) -> None:
    files.change("collision: {}", "near: {stl: always (twin_distance_m < 1)}")
    assert files.load().modes == ("sim", "wil")
