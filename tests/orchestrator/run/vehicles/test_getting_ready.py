"""What happens until vehicles arm: in which order, and how often each is asked."""

import asyncio
import math
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from wil_campaign.campaigns.setup.case_setup import SyncSetup
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.external.motion_captures import MotionCaptures
from wil_campaign.orchestrator.run.stages.before_arming import BeforeArming
from wil_campaign.orchestrator.run.stages.operator_hold import OperatorHold
from wil_campaign.orchestrator.run.stages.pair_flight import fly_together
from wil_campaign.orchestrator.run.vehicles.arming_record import ArmingRecord
from wil_campaign.orchestrator.run.vehicles.onboard_configuration import flight_log
from wil_campaign.orchestrator.run_results.run_result import NOT_ARMED
from wil_campaign.orchestrator.state.run_state import FlightError, RunState
from wil_campaign.safety.guard.core.events import GuardEvent
from wil_campaign.vehicles.errors import VehicleError

SYNC = SyncSetup(
    identify_timeout_s=9.0,
    ready_timeout_s=90.0,
    takeoff_timeout_s=9.0,
    takeoff_tolerance_m=0.1,
    goal_timeout_s=9.0,
    landing_timeout_s=9.0,
    max_command_skew_s=1.0,
    max_takeoff_skew_s=1.0,
    max_t0_skew_s=1.0,
)


@dataclass
class Standing:
    """A vehicle that is ready after a time, and writes down what it is asked."""

    name: str
    ready_after_s: float
    asked: list[tuple[float, str]]
    identity: Any = field(default_factory=lambda: SimpleNamespace(uid=None, uid2=None))
    clock: Any = field(default_factory=lambda: SimpleNamespace(reboots=0))

    @property
    def driver(self) -> "Standing":
        return self

    def note(self, what: str) -> None:
        self.asked.append((asyncio.get_running_loop().time(), f"{self.name} {what}"))

    async def identify(self, timeout_s: float) -> None:
        del timeout_s

    async def ready(self, timeout_s: float) -> None:
        del timeout_s
        await asyncio.sleep(max(0.0, self.ready_after_s - asyncio.get_running_loop().time()))
        self.note("ready")


def test_the_vehicle_that_was_ready_first_is_asked_again_when_all_are(monkeypatch: Any) -> None:
    """A PX4 in SIH waited 45 s for an ArduCopter: its estimate had left its anchor by 0.54 m."""
    monkeypatch.setattr(
        "wil_campaign.orchestrator.run.stages.distinct_vehicles.same_vehicle", lambda *_: False
    )
    asked: list[tuple[float, str]] = []

    async def flown() -> str:
        run_state = RunState(time=asyncio.get_running_loop().time)
        contexts = (Standing("real", 45.0, asked), Standing("twin", 5.0, asked))

        async def report(what: str, *_: object, **__: object) -> str:
            asked.append((asyncio.get_running_loop().time(), what))
            return what

        async def goal(_: float) -> None:
            raise AssertionError("flown without arming")

        async def put(context: Any) -> None:
            context.note("prepared")

        loop = asyncio.get_running_loop()
        record = ArmingRecord(now=loop.time, note=lambda *_, **__: None)
        before_arming = BeforeArming(
            setup=cast(
                "Any",
                SimpleNamespace(
                    case=SimpleNamespace(sync=SYNC),
                    vehicle=lambda _: SimpleNamespace(anchor="start"),
                    flown=lambda _: SimpleNamespace(attached=None),
                ),
            ),
            guard=cast("Any", SimpleNamespace(events=[])),
            contexts=cast("Any", contexts),
            external_io=cast(
                "Any",
                SimpleNamespace(
                    before_arming=partial(report, "proven"), captures=MotionCaptures({})
                ),
            ),
            preflight=cast("Any", SimpleNamespace(check=partial(report, "preflight"))),
            configuration=cast("Any", SimpleNamespace(apply=put, unbooted={})),
            record=record,
        )
        await fly_together(
            contexts,  # type: ignore[arg-type]  # as much of them as is used
            run_state=run_state,
            operator_hold=OperatorHold(run_state=run_state),
            sync=SYNC,
            heights_m={},
            liftoff_delays_s={},
            stagger=lambda _: None,
            before_arming=before_arming.apply,
            check_again=before_arming.check_again,
            barrier=lambda: None,
            goal=goal,
            arm=False,
        )
        assert [(step.step, step.text) for step in before_arming.steps] == [
            ("external", "proven"),
            ("preflight", "preflight"),
        ]
        return run_state.decisive[0].text

    assert run_virtual(flown()) == NOT_ARMED
    assert asked == [
        (5.0, "twin ready"), (45.0, "real ready"),
        (45.0, "real prepared"), (45.0, "twin prepared"),
        (45.0, "real ready"), (45.0, "twin ready"),
        (45.0, "proven"), (45.0, "preflight"),
    ]  # fmt: skip


def test_the_log_of_the_flight_is_found(tmp_path: Path) -> None:
    """Their folders as ArduCopter 4.7 and PX4 left them."""
    assert flight_log(tmp_path / "none") is None
    copter, px4 = tmp_path / "real-sitl", tmp_path / "twin-sitl"
    for file, size in (
        (px4 / "log" / "2026-11-21" / "21_06_38.ulg", 8102764),
        (px4 / "parameters.bson", 4000),
        (copter / "logs" / "00000001.BIN", 1593344),
        (copter / "logs" / "00000002.BIN", 40960),
        (copter / "logs" / "00000003.BIN", 0),
        (copter / "logs" / "LASTLOG.TXT", 3),
        (copter / "eeprom.bin", 9999999),
    ):
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("wb") as made:
            made.truncate(size)
    assert flight_log(px4) == px4 / "log" / "2026-11-21" / "21_06_38.ulg"
    assert flight_log(copter) == copter / "logs" / "00000001.BIN"
    (copter / "logs" / "00000001.BIN").unlink()
    (copter / "logs" / "00000002.BIN").unlink()
    assert flight_log(copter) is None


@dataclass
class Doubled(Standing):
    """A vehicle beside which a second one of its id is heard after a time."""

    second_s: float = math.inf
    received_for_s: float = math.inf

    def request_version(self) -> None:
        self.note("version")

    def require_alone(self) -> None:
        if asyncio.get_running_loop().time() >= self.second_s:
            raise VehicleError(f"{self.name}: two vehicles")


@pytest.mark.parametrize(
    ("second_s", "said"), [(10.5, "real: two vehicles"), (math.inf, "real: fence: refused")]
)
def test_a_second_vehicle_is_named_where_its_answers_refuse_the_configuration(
    monkeypatch: pytest.MonkeyPatch, second_s: float, said: str
) -> None:
    """Two ArduCopters behind one router refused the fence, and the second was heard later."""
    monkeypatch.setattr(
        "wil_campaign.orchestrator.run.stages.distinct_vehicles.same_vehicle", lambda *_: False
    )

    async def put(context: Any) -> None:
        await asyncio.sleep(10.0)
        raise VehicleError(f"{context.name}: fence: refused")

    async def apply() -> None:
        await BeforeArming(
            setup=cast(
                "Any",
                SimpleNamespace(
                    case=SimpleNamespace(sync=SYNC),
                    flown=lambda _: SimpleNamespace(attached=True),
                ),
            ),
            guard=cast("Any", SimpleNamespace(events=[])),
            contexts=cast("Any", (Doubled("real", 0.0, [], second_s=second_s),)),
            external_io=cast("Any", SimpleNamespace(captures=MotionCaptures({}))),
            preflight=cast("Any", None),
            configuration=cast("Any", SimpleNamespace(apply=put, unbooted={})),
            record=ArmingRecord(now=asyncio.get_running_loop().time, note=lambda *_, **__: None),
        ).apply()

    with pytest.raises(VehicleError) as refused:
        run_virtual(apply())
    assert str(refused.value) == said


@pytest.mark.parametrize("at", ["before", "meanwhile"])
def test_a_vehicle_with_a_rival_never_arms(monkeypatch: pytest.MonkeyPatch, at: str) -> None:
    monkeypatch.setattr(
        "wil_campaign.orchestrator.run.stages.distinct_vehicles.same_vehicle", lambda *_: False
    )
    rival = GuardEvent(1.0, "rival", "real", "system 1 sends from two ports")
    events = [rival] if at == "before" else []
    done: list[str] = []

    async def put(context: Any) -> None:
        done.append(f"{context.name} prepared")

    async def external(*_: object, **__: object) -> str:
        return ""

    async def check(*_: object) -> str:
        events.append(rival)
        return ""

    async def apply() -> None:
        await BeforeArming(
            setup=cast(
                "Any",
                SimpleNamespace(
                    case=SimpleNamespace(sync=SYNC),
                    vehicle=lambda _: SimpleNamespace(anchor="start"),
                    flown=lambda _: SimpleNamespace(attached=None),
                ),
            ),
            guard=cast("Any", SimpleNamespace(events=events)),
            contexts=cast("Any", (Standing("real", 0.0, []), Standing("twin", 0.0, []))),
            external_io=cast(
                "Any", SimpleNamespace(before_arming=external, captures=MotionCaptures({}))
            ),
            preflight=cast("Any", SimpleNamespace(check=check)),
            configuration=cast("Any", SimpleNamespace(apply=put, unbooted={})),
            record=ArmingRecord(now=asyncio.get_running_loop().time, note=lambda *_, **__: None),
        ).apply()

    with pytest.raises(FlightError) as refused:
        run_virtual(apply())
    assert str(refused.value) == (
        "real: system 1 sends from two ports; switch one off, or give one another id "
        "(MAV_SYS_ID of PX4, MAV_SYSID of ArduPilot, before 4.7 SYSID_THISMAV)"
    )
    # No parameter is written to a vehicle that may be the wrong one.
    assert done == ([] if at == "before" else ["real prepared", "twin prepared"])
