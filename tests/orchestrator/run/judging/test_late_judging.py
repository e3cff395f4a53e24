"""A judge that had no processor for a while blames no vehicle for it."""

from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.orchestrator.wall import write_wall
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.run.judging.oracle_runner import OracleRunner
from wil_campaign.orchestrator.run.judging.run_oracles import build_judge
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.model.samples import StageSample
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.worlds.frames import Pose

PERIOD_S = 0.05


class LateJudge:
    """A judge with the oracle of a link, and a vehicle whose bytes have the time of arrival."""

    def __init__(self, folder: Path) -> None:
        sets = ("oracles.link={max_gap_s: 1.0, vehicle: twin}",)
        plan = load_campaign(write_wall(folder), ExpansionOptions(sets=sets)).runs[0]
        setup = RunSetup.of(RunOrder(plan=plan, folder=folder, clock="virtual"))
        self.judge = build_judge(setup, {})
        link, _ = memory_pair(latency_s=0.0)
        driver = Driver(name="twin", link=link)
        driver._session.target = MavlinkTarget(1)
        self._received: Any = driver._session.received
        self._bytes = MavlinkCodec(system_id=1, component_id=1).pack(
            mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3)
        )
        self.runner = OracleRunner(
            judge=self.judge,
            run_state=RunState(time=lambda: 0.0),
            kinds={},
            flag_watchers=(),
            log_sample=lambda _: None,
        )
        start = Pose((0.0, 0.0, 0.0))
        self.runner.attach(VehicleContext("twin", driver, start, "mavlink"))

    def sends(self, from_s: float, to_s: float) -> None:
        for count in range(round((to_s - from_s) / PERIOD_S)):
            self._received(self._bytes, from_s + count * PERIOD_S)

    def flags(self) -> list[str]:
        return [flag.text for flag in self.judge.flags if flag.oracle == "link"]


@pytest.fixture
def late(tmp_path: Path) -> LateJudge:
    return LateJudge(tmp_path)


def test_a_vehicle_that_sent_all_the_time_was_not_silent(late: LateJudge) -> None:
    """Seen with two ArduCopters at three times real time on a busy machine, and FAILed for it."""
    late.sends(0.0, 1.0)
    late.runner.last_state(1.0)
    late.judge.stage(StageSample(1.0, "takeoff"))
    late.sends(1.0, 4.0)
    late.runner.last_state(4.0)
    assert late.flags() == []


def test_silence_is_found_however_late_the_judge_looks(late: LateJudge) -> None:
    late.sends(0.0, 1.0)
    late.runner.last_state(1.0)
    late.judge.stage(StageSample(1.0, "takeoff"))
    late.sends(1.0, 2.0)
    late.sends(3.75, 6.0)
    late.runner.last_state(6.0)
    assert late.flags() == ["twin was silent for 1.8 s, more than 1 s"]


def test_a_stage_finds_no_silence_where_the_judge_had_not_looked_yet(late: LateJudge) -> None:
    """Seen with a PX4 at twice real time on a busy machine: 1.064 s, of a link without a gap."""
    late.sends(0.0, 1.0)
    late.runner.last_state(1.0)
    late.judge.stage(StageSample(1.0, "takeoff"))
    late.sends(1.0, 3.0)
    late.runner._stage("landed", 3.0)
    (link,) = [result for result, _ in late.runner.results(3.0) if result.name == "link"]
    assert link.verdict == "PASS"
    assert link.actual == pytest.approx(0.2, abs=0.06)
