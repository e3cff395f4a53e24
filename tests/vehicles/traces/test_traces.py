"""The embedded autopilots fly the script of the reference traces and are held to the real ones.

Golden files: `python tests/vehicles/traces/distil.py TLOG > GOLDEN.json` from the .tlog of a real
ArduCopter 4.7 SITL and a real PX4 1.18 SITL (SIH).
"""

import importlib.util
import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.profile import load_profile
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.links.memory import memory_pair

HERE = Path(__file__).parent


def sibling(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"wil_traces_{name}", HERE / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


DISTIL, SCRIPT = sibling("distil"), sibling("script")


@dataclass(frozen=True)
class Tolerance:
    """Seconds by which an event may differ, and why; by anchor where it differs."""

    default_s: float
    by_anchor_s: dict[str, float]


EVENTS = {
    # Seen in heartbeats of 1 Hz: a second of phase. Takeoff takes our airframe a second less, and
    # the script's next command comes as much earlier.
    "modes": Tolerance(1.1, {"armed": 2.3}),
    # 5 Hz. From takeoff to "in the air" as above; the descent starts from another height on PX4
    # (its climb of RTL is another), and is compared by its speed instead.
    "landed": Tolerance(0.5, {"armed": 1.2, "flying": 0.4, "land": 4.0}),
    # Sent at 2 and 5 Hz, 1 and 5 Hz, 5 Hz.
    "prearm": Tolerance(0.6, {}),
    "estimator": Tolerance(0.6, {"armed": 1.1, "landed": 1.1}),
    "gps": Tolerance(0.3, {}),
    "texts": Tolerance(0.3, {"armed": 0.5, "land": 4.0}),
    # The script waits for the height before it goes on.
    "acks": Tolerance(0.2, {"armed": 2.0}),
}
FIRST_IS_START_OF_RECORDING = {"modes", "landed", "prearm", "estimator", "gps"}
"""States that hold when the recording begins, 1 to 2.5 s after boot in the traces."""

FLIGHT = {
    "lift_after_arm_s": 0.5,
    # PX4's SIH climbs with more drag than ours.
    "climb_to_4_m_s": 1.0,
    "highest_before_flying_m": 0.3,
    # SIH is heavier, has more drag, and leans into it for seconds; ours gets there sooner.
    "moved_north_m": 2.3,
    "speed_when_stopped_m_s": 0.4,
    "slower_than_1_m_s_after_stop_s": 0.6,
    "descent_m_s": 0.06,
}

NOT_SENT = {
    "ATTITUDE_TARGET": "the controller's inner setpoints are its own",
    "OPEN_DRONE_ID_LOCATION": "no remote identification",
    "OPEN_DRONE_ID_SYSTEM": "no remote identification",
    "COMMAND_LONG": "no camera or gimbal is looked for",
    "PARAM_VALUE": "calibration results of the board's own sensors",
}
PHASE_DEPENDENT = {
    "STATUSTEXT",
    "COMMAND_ACK",
    "GPS_GLOBAL_ORIGIN",
    "POSITION_TARGET_LOCAL_NED",
    "POSITION_TARGET_GLOBAL_INT",
}
"""Sent on events, or only while flying, which takes other times here."""


async def flown(autopilot: str) -> Any:
    near, far = memory_pair(latency_s=0.003)
    profile = load_profile("px4-sih" if autopilot == "px4" else "ardupilot-sitl")
    config = EmbeddedConfig(autopilot=autopilot, profile=profile, full_streams=True)
    fly = SCRIPT.fly_px4 if autopilot == "px4" else SCRIPT.fly_copter
    async with EmbeddedVehicle(config=config, link=near, seed=1):
        return await fly(far)


def landed_and_armed(event: list[Any]) -> bool:
    """Whether a heartbeat fell between landing and disarming: 0.4 s on ArduCopter, by chance."""
    anchor, _, base_mode, _, status = event
    return anchor in {"land", "landed"} and bool(base_mode & 128) and status == 3


@pytest.fixture(scope="module", params=["px4-1.18-offboard", "arducopter-4.7-guided"])
def pair(request: pytest.FixtureRequest) -> tuple[dict[str, Any], dict[str, Any]]:
    name = request.param
    golden = json.loads((HERE / f"{name}.json").read_text(encoding="utf-8"))
    autopilot = "px4" if name.startswith("px4") else "ardupilot"
    ours = asdict(DISTIL.distil(run_virtual(flown(autopilot))))
    for line in (golden, ours):
        line["modes"] = [event for event in line["modes"] if not landed_and_armed(event)]
    return golden, ours


def test_it_identifies_itself(pair: tuple[dict[str, Any], dict[str, Any]]) -> None:
    golden, ours = pair
    assert ours["identity"] == golden["identity"]


@pytest.mark.parametrize("kind", sorted(EVENTS))
def test_same_events_in_the_same_order(
    pair: tuple[dict[str, Any], dict[str, Any]], kind: str
) -> None:
    golden, ours = pair
    assert [event[2:] for event in ours[kind]] == [event[2:] for event in golden[kind]]


@pytest.mark.parametrize("kind", sorted(EVENTS))
def test_events_at_the_same_times(pair: tuple[dict[str, Any], dict[str, Any]], kind: str) -> None:
    golden, ours = pair
    tolerance = EVENTS[kind]
    faults = []
    first = 1 if kind in FIRST_IS_START_OF_RECORDING else 0
    for theirs, mine in list(zip(golden[kind], ours[kind], strict=True))[first:]:
        anchor, after_s = theirs[:2]
        limit_s = tolerance.by_anchor_s.get(anchor, tolerance.default_s)
        if mine[0] != anchor or abs(mine[1] - after_s) > limit_s:
            faults.append(f"{mine} is not within {limit_s} s of {theirs}")
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize("measure", sorted(FLIGHT))
def test_flies_alike(pair: tuple[dict[str, Any], dict[str, Any]], measure: str) -> None:
    golden, ours = pair
    assert ours["flight"][measure] == pytest.approx(golden["flight"][measure], abs=FLIGHT[measure])


def test_sends_as_often(pair: tuple[dict[str, Any], dict[str, Any]]) -> None:
    golden, ours = pair
    theirs = {name: hz for name, hz in golden["rates_hz"].items() if name not in NOT_SENT}
    compared = theirs.keys() - PHASE_DEPENDENT
    assert theirs.keys() <= ours["rates_hz"].keys()
    faults = {
        name: (ours["rates_hz"][name], theirs[name])
        for name in compared
        if ours["rates_hz"][name] != pytest.approx(theirs[name], rel=0.06, abs=0.05)
    }
    assert not faults


def test_position_comes_when_the_estimator_has_it(
    pair: tuple[dict[str, Any], dict[str, Any]],
) -> None:
    golden, ours = pair
    anchor, at_s = golden["first_local_position"]
    assert ours["first_local_position"][0] == anchor
    # PX4's trace begins 0.9 s after boot.
    assert ours["first_local_position"][1] == pytest.approx(at_s, abs=1.0)


def test_golden_files_are_what_the_design_says(
    pair: tuple[dict[str, Any], dict[str, Any]],
) -> None:
    golden, _ = pair
    assert [event[2] for event in golden["landed"]] == [1, 3, 2, 4, 1]
