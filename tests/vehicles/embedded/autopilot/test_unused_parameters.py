"""Parameters of the embedded vehicles that nothing acts on: all are marked, and they say so."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.embedded.autopilot.bare_autopilot import BareAutopilot
from wil_campaign.vehicles.embedded.autopilot.known_parameters import (
    known_parameters,
    unused_parameters,
)

_ROOT = Path(__file__).parents[4]
_DOCS = _ROOT / "docs"
_PAGE = (_DOCS / "vehicle.md").read_text(encoding="utf-8")
_DECISION = (_DOCS / "decisions" / "0023-control-laws-of-the-firmwares.md").read_text("utf-8")
_LISTS: dict[str, str] = {"px4": "PX4", "ardupilot": "ArduCopter"}
REFUSED = {"px4": ["EKF2_EV_CTRL"], "ardupilot": ["ARMING_CHECK", "RNGFND1_TYPE"]}
COMMON = {
    "px4": "MPC_ACC_HOR_MAX MPC_JERK_MAX MPC_TILTMAX_LND MPC_THR_MIN MPC_THR_MAX SIM_BAT_DRAIN",
    "ardupilot": "SIM_SPEEDUP SIM_WIND_SPD SIM_WIND_DIR FLTMODE1 LOG_BITMASK",
}
"""What scripts commonly set, and the firmwares have: it is there, with or without an effect."""
AUTOPILOTS: tuple[str, ...] = ("px4", "ardupilot")
EFFECTS = {"px4": ("RTL_TYPE", "RTL_RETURN_ALT"), "ardupilot": ("FS_EKF_ACTION", "RTL_ALT_FINAL")}
"""A parameter without and one with effect, of each; both are whole numbers but RTL_RETURN_ALT."""


def patterns() -> Iterator[str]:
    """Yield regular expressions of the texts in the code of the embedded vehicles."""
    folders = ("vehicles/embedded", "plugins/ardupilot/copter")
    for file in (file for folder in folders for file in (_ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            match node:
                case ast.Constant(value=str(text)):
                    yield re.escape(text)
                case ast.JoinedStr(values=parts):
                    fixed = [p.value for p in parts if isinstance(p, ast.Constant)]
                    if re.fullmatch(r"[A-Z][A-Z0-9_]+", "".join(map(str, fixed))):
                        texts = [
                            re.escape(str(p.value)) if isinstance(p, ast.Constant) else r"\w+"
                            for p in parts
                        ]
                        yield "".join(texts)


@cache
def used_in_code() -> re.Pattern[str]:
    return re.compile("|".join(sorted(set(patterns()))))


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_the_file_of_parameters_marks_those_that_no_code_names(autopilot: str) -> None:
    used = used_in_code()
    unnamed = {name for name in known_parameters(autopilot) if not used.fullmatch(name)}
    assert set(unused_parameters(autopilot)) == unnamed


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_the_decision_lists_them_all(autopilot: str) -> None:
    pattern = rf"^{_LISTS[autopilot]}: ((?:`\w+`[,.]\s)+)"
    (listed,) = re.findall(pattern, _DECISION, re.MULTILINE)
    assert re.findall(r"`(\w+)`", listed) == sorted(unused_parameters(autopilot))


def set_parameter(bare: BareAutopilot, name: str, value: float) -> list[str]:
    """Set a parameter; return the STATUSTEXTs that follow."""
    parameters = bare.autopilot.parameters
    kind = parameters.kind(name)
    before = parameters[name]
    parameters.set(name, value)
    wire = parameters.to_wire(name)
    parameters.set(name, before)
    bare.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), wire, kind))
    assert parameters[name] == value
    return [one.text for one in bare.run(0.1) if one.get_type() == "STATUSTEXT"]


@pytest.fixture(params=AUTOPILOTS)
def bare(request: pytest.FixtureRequest) -> BareAutopilot:
    bare = BareAutopilot(request.param)
    bare.run(50.0)
    gcs = mavlink.MAV_TYPE_GCS
    bare.send(mavlink.MAVLink_heartbeat_message(gcs, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3))
    bare.run(0.1)
    return bare


def test_the_vehicle_announces_once_that_a_parameter_has_no_effect(bare: BareAutopilot) -> None:
    without, with_effect = EFFECTS["px4" if bare.autopilot.firmware.bytewise else "ardupilot"]
    assert set_parameter(bare, with_effect, 3.0) == []
    assert set_parameter(bare, without, bare.autopilot.parameters[without]) == []
    assert set_parameter(bare, without, 2.0) == [f"{without} has no effect in this emulation"]
    assert set_parameter(bare, without, 3.0) == []


def test_a_fence_of_a_campaign_is_no_reason_to_announce_anything() -> None:
    bare = BareAutopilot("ardupilot")
    bare.run(50.0)
    assert set_parameter(bare, "FENCE_MARGIN", 0.0) == []
    assert set_parameter(bare, "FENCE_MARGIN", 2.0) == []
    assert set_parameter(bare, "FENCE_MARGIN", 1.0) != []


def test_a_text_fits_into_one_message() -> None:
    names = [name for autopilot in AUTOPILOTS for name in unused_parameters(autopilot)]
    assert max(len(f"{name} has no effect in this emulation") for name in names) <= 50


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_what_scripts_commonly_set_is_there(autopilot: str) -> None:
    assert not set(COMMON[autopilot].split()) - set(known_parameters(autopilot))


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_parameters_that_the_page_lists_as_refused_are_refused(autopilot: str) -> None:
    pattern = rf"^{_LISTS[autopilot]}: ((?:`\w+`[,.]\s)+)"
    (listed,) = re.findall(pattern, _PAGE, re.MULTILINE)
    names = re.findall(r"`(\w+)`", listed)
    assert names == REFUSED[autopilot]
    bare = BareAutopilot(autopilot)
    for name in names:
        message = mavlink.MAVLink_param_set_message(1, 1, name.encode(), 1.0, 9)
        kinds = [one.get_type() for one in bare.send(message)]
        assert kinds == (["PARAM_ERROR"] if autopilot == "px4" else []), name
