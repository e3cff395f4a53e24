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
    ("altitude: {max_m: @2 m}", "must be a number, is the text '2 m' (a plain number; its unit"),
    ("altitude: {max_m: @.nan}", "must be a number, is the text '.nan' (it must be finite)"),
    ("altitude: {min_m: @3, max_m: 2}", "3 is not below max_m"),
    ("modes: {allowed: @[]}", "names no mode"),
    ("altitude: {max_m: 2, from: @start}", "must be takeoff, at_height, goal, done or land, is"),
    ("altitude: {max_m: 2, from: @landed}", "must be takeoff, at_height, goal, done or land, is"),
    ("altitude: {max_m: 2, from: land, to: @goal}", "its window is empty: 'land' does not come"),
    ("altitude: {max_m: 2, required: false, fail_fast: @true}", "an oracle that is only reported"),
    ("late: {use: reached, fail_fast: @true}", "only the end of its window shows whether it"),
    ("distance: {object: @gaet, min_m: 1}", "no object 'gaet' stands in the judged world"),
    ("landed: {@from: goal}", "unknown key 'from'"),
    ("modes: {allowed: [@GUIDED]}", "must be hold, takeoff, guided, land, rtl, mission, pilot or"),
    ("altitude: {max_m: 2, vehicle: @both}", "must be real or twin, is 'both'"),
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
