"""The operator holds and lets go on, at every stage of a flight."""

import asyncio
import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.faults.relay import LOCAL_POSITION_NED
from tests.faults.wire_changes import padded, through
from tests.orchestrator.conftest import BRIEF
from tests.orchestrator.flights import all_landed, log_of
from wil_campaign.orchestrator.run.stages.operator_hold import OperatorHold
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.safety.guard.core.events import GuardEvent
from wil_campaign.safety.guard.core.operator_command import OperatorCommand, OperatorKind
from wil_campaign.vehicles.mavlink.framing import MavlinkFrame, frame_with_payload

Fly = Callable[..., tuple[RunResult, Path]]
LONGER = (*BRIEF, "autonomy.with.for_s=6")


class Operator:
    """Gives commands some time after a stage is entered; an inbox and a disturbance in one."""

    def __init__(self, stage: Stage, *script: tuple[float, OperatorKind]) -> None:
        self._stage = stage
        self._script = list(script)
        self._since_s: float | None = None

    def __call__(self, pair: VehiclePair, run_state: RunState) -> None:
        def entered(name: Stage, t_s: float) -> None:
            if name == self._stage and self._since_s is None:
                self._since_s = t_s

        run_state.on_stage(entered)

    def poll(self) -> OperatorCommand | None:
        now_s = asyncio.get_running_loop().time()
        if self._since_s is None or not self._script:
            return None
        after_s, kind = self._script[0]
        if now_s < self._since_s + after_s:
            return None
        self._script.pop(0)
        return OperatorCommand(kind, "anna")


def fly_held(fly_run: Fly, stage: Stage, *script: tuple[float, OperatorKind], **more: Any) -> Any:
    operator = Operator(stage, *script)
    return fly_run(inbox=operator, disturb=operator, **more)


def entered(folder: Path) -> dict[str, float]:
    return {line["stage"]: line["t_s"] for line in log_of(folder) if line["event"] == "stage"}


STAGES: list[tuple[Stage, float]] = [
    ("ready", 1.0),
    ("arm", 0.0),
    ("takeoff", 0.3),
    ("takeoff", 2.5),
    ("at_height", 0.2),
]


@pytest.mark.parametrize(
    ("campaign", "stage", "after_s"),
    [
        *(("gate", stage, after_s) for stage, after_s in STAGES),
        # ArduCopter takes off in another way; before it, nothing differs.
        *(("gate-ardupilot", stage, after_s) for stage, after_s in STAGES if stage == "takeoff"),
    ],
)
def test_a_hold_before_the_goal_only_delays_it(
    fly_run: Fly, campaign: str, stage: Stage, after_s: float
) -> None:
    result, folder = fly_held(
        fly_run,
        stage,
        (after_s, "hold"),
        (after_s + 12.0, "resume"),
        campaign=campaign,
        sets=(*BRIEF, "sync.max_takeoff_skew_s=9"),
        boots=stage == "ready",
    )
    assert (result.verdict, result.reason) == ("PASS", "")
    times = entered(folder)
    resumed_s = times[stage] + after_s + 12.0
    assert resumed_s < times["goal"] < resumed_s + 10.0
    assert all_landed(folder)


_STAMPED = frozenset({LOCAL_POSITION_NED, mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION})


def changed(frame: MavlinkFrame, what: str) -> bytes:
    """Return a frame of a vehicle that is empty, moved, switched off, or armed by somebody."""
    payload = padded(frame, 31)
    if what == "battery" and frame.message_id == mavlink.MAVLINK_MSG_ID_SYS_STATUS:
        payload[30] = 5
    elif what == "moved" and frame.message_id == LOCAL_POSITION_NED:
        (north_m,) = struct.unpack_from("<f", payload, 4)
        struct.pack_into("<f", payload, 4, north_m + 3.0)
    elif what == "armed" and frame.message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
        payload[6] |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    elif what == "reboot" and frame.message_id in _STAMPED:
        (boot_ms,) = struct.unpack_from("<I", payload)
        struct.pack_into("<I", payload, 0, boot_ms - 60_000)
    else:
        return frame.raw
    return frame_with_payload(frame, bytes(payload))


@pytest.mark.parametrize(
    ("campaign", "stage", "what", "why"),
    [
        ("gate", "ready", "battery", "preflight: twin battery: its charge is 0.05"),
        ("gate", "arm", "battery", "preflight: twin battery: its charge is 0.05"),
        ("gate", "takeoff", "battery", "preflight: twin battery: its charge is 0.05"),
        ("gate", "ready", "moved", "twin was moved by 3.0 m after its fence had been uploaded"),
        ("gate-ardupilot", "ready", "reboot", "twin rebooted after its parameters and fence"),
        ("gate", "ready", "armed", "twin: not ready to arm within 30 s: it is armed"),
    ],
)
def test_a_vehicle_that_stood_through_a_hold_is_checked_again_before_it_arms(
    fly_run: Fly, campaign: str, stage: Stage, what: str, why: str
) -> None:
    operator = Operator(stage, (0.1, "hold"), (40.0, "resume"))

    def disturb(pair: VehiclePair, run_state: RunState) -> None:
        operator(pair, run_state)

        def change(frame: MavlinkFrame, run_state: RunState) -> Iterable[bytes]:
            since_s = run_state.entered_s.get(stage, 99.0)
            is_later = since_s + 20.0 < asyncio.get_running_loop().time() < since_s + 100.0
            yield changed(frame, what) if is_later else frame.raw

        through(change)(pair, run_state)

    result, folder = fly_run(
        campaign, "large", "sim", inbox=operator, disturb=disturb, sets=(*BRIEF,)
    )
    assert (result.verdict, result.reason[: len(why)]) == ("ERROR", why)
    last = [line for line in log_of(folder) if line["event"] == "stage"]
    assert "goal" not in [line["stage"] for line in last]
    assert all_landed(folder)


@pytest.mark.parametrize("campaign", ["gate", "gate-ardupilot"])
def test_a_hold_after_the_goal_proves_nothing_and_the_flight_goes_on(
    fly_run: Fly, campaign: str
) -> None:
    script: list[tuple[float, OperatorKind]] = [(2.0, "hold"), (12.0, "resume")]
    result, folder = fly_held(
        fly_run, "goal", *script, campaign=campaign, sets=(*BRIEF, "autonomy.with.for_s=13")
    )
    assert result.verdict == "INVALID"
    assert result.reason == "held by anna after the goal was given: the flight proves nothing"
    times = entered(folder)
    assert times["done"] > times["goal"] + 12.0
    assert all_landed(folder)


def test_nothing_of_the_flight_ends_it_while_it_is_held(fly_run: Fly) -> None:
    result, folder = fly_held(
        fly_run,
        "goal",
        (1.0, "hold"),
        (14.0, "resume"),
        sets=(*LONGER, "oracles.time_limit.limit_s=5"),
    )
    assert result.verdict == "INVALID"
    assert result.also[0].reason == "real was not done 5 s after its goal"
    times = entered(folder)
    assert times["goal"] + 14.0 < times["land"] < times["goal"] + 14.5
    assert all_landed(folder)


def test_a_hold_while_landing_stops_it_in_the_air(fly_run: Fly) -> None:
    result, folder = fly_held(fly_run, "land", (1.0, "hold"), (20.0, "resume"), sets=BRIEF)
    assert result.verdict == "INVALID"
    times = entered(folder)
    assert times["landed"] > times["land"] + 20.0
    assert all_landed(folder)


def test_the_operator_may_abort_during_a_hold(fly_run: Fly) -> None:
    script: list[tuple[float, OperatorKind]] = [(2.0, "hold"), (4.0, "hold"), (12.0, "abort")]
    result, folder = fly_held(fly_run, "takeoff", *script, sets=BRIEF)
    assert (result.verdict, result.reason) == ("ABORTED", "aborted by anna")
    said = [line["text"] for line in log_of(folder) if line["event"] == "guard"]
    assert "anna: hold: all vehicles hold already" in said
    assert entered(folder)["landed"] > entered(folder)["takeoff"] + 12.0
    assert all_landed(folder)


def test_a_log_that_ends_during_a_hold_leaves_the_rest_to_the_operator() -> None:
    run_state = RunState(time=lambda: 1.0)
    hold = OperatorHold(run_state=run_state)
    hold.receive(GuardEvent(1.0, "hold", "", "anna: hold"))
    hold.receive(GuardEvent(2.0, "record", "real", "the recording ended early"))
    assert run_state.held
    hold.receive(GuardEvent(3.0, "resume", "", "anna: resume"))
    assert not run_state.held
