"""Whole flights in virtual time: good ones, and each way in which one can go wrong."""

import asyncio
import errno
import json
import os
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import av
import pytest

from tests.orchestrator.conftest import BRIEF, SMALL_CAMERAS
from tests.orchestrator.flights import all_landed, log_of, rows_of
from tests.plugins.console.feed.feed_reader import reading_feed
from wil_campaign.foundation.background_file import BackgroundFile, DiskPatience
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.recording import run_recorder
from wil_campaign.orchestrator.recording.mcap import mcap_writer
from wil_campaign.orchestrator.recording.mcap.mcap_chunks import RecordStream
from wil_campaign.orchestrator.recording.mcap.mcap_file import ChunkedFile
from wil_campaign.orchestrator.recording.run_video import make_video
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.run_results.caveats import campaign_caveats
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state import run_log
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.plugins.console.feed.console_feed import ConsoleFeed
from wil_campaign.plugins.console.feed.feed_messages import EventView, ImageView, RunView
from wil_campaign.safety.guard.core.commands import OperatorAction
from wil_campaign.safety.guard.core.events import GuardEvent
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.vehicles.autonomy import Command, Telemetry
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.setpoints import VelocitySetpoint

Fly = Callable[..., tuple[RunResult, Path]]


def at_stage(stage: Stage, after_s: float, do: Callable[[VehiclePair], None]) -> Any:
    """Return a disturbance that does something some time after a stage is entered."""

    def disturb(pair: VehiclePair, run_state: RunState) -> None:
        def entered(name: Stage, _: float) -> None:
            if name == stage:
                asyncio.get_running_loop().call_later(after_s, do, pair)

        run_state.on_stage(entered)

    return disturb


class Script:
    """An operator who aborts at a time of the run clock."""

    def __init__(self, at_s: float) -> None:
        self.at_s = at_s
        self.said = False

    def poll(self) -> OperatorCommand | None:
        if self.said or asyncio.get_running_loop().time() < self.at_s:
            return None
        self.said = True
        return OperatorCommand("abort", "tester", "enough seen")


def assert_whole(folder: Path, result: RunResult) -> None:
    """Find every file of a run, readable."""
    assert result.mixing is not None
    assert set(result.artifacts) == {
        "judged.msgpack",
        "log.jsonl",
        "real.tlog",
        "run.mcap",
        "trajectory.csv",
        "twin.tlog",
    }
    assert make_video(folder)
    with av.open(str(folder / "mixed.mp4")) as video:
        frames = sum(1 for _ in video.decode(video=0))
    assert frames == result.mixing.frames
    stages = [line["stage"] for line in log_of(folder) if line["event"] == "stage"]
    assert stages == [
        "identify",
        "ready",
        "arm",
        "takeoff",
        "at_height",
        "goal",
        "done",
        "land",
        "landed",
        "end",
    ]


@pytest.mark.parametrize("campaign", ["gate", "gate-ardupilot"])
def test_the_pair_flies_through_the_virtual_gate_and_leaves_its_files(
    fly_run: Fly, campaign: str
) -> None:
    result, folder = fly_run(campaign, boots=True, cameras=SMALL_CAMERAS)
    assert (result.verdict, result.reason) == ("PASS", "")
    oracles = {(o.name, o.vehicle): o for o in result.oracles}
    reached = oracles["reached", "real"]
    assert reached.actual is not None
    assert isinstance(reached.limit, float)
    assert 0.0 <= reached.actual < 0.35
    # The limit leaves room for the body, which reaches 0.14 to 0.2 m beyond its centre.
    assert 0.3 < reached.limit < 0.36
    assert reached.margin == pytest.approx(reached.limit - reached.actual)
    clearance = oracles["collision", "real"].actual
    assert clearance is not None
    assert 0.0 < clearance < 0.5
    assert oracles["reached", "twin"].required is False
    assert result.sync.command_skew_s == 0.0
    assert result.sync.takeoff_skew_s is not None
    assert result.sync.takeoff_skew_s < 1.0
    assert result.mixing is not None
    assert result.mixing.rate_hz == pytest.approx(15.0, abs=0.2)
    assert result.mixing.skew_ms.p99 == 0.0
    assert result.mixing.registration_error_px is not None
    assert result.mixing.registration_error_px.p50 is not None
    assert all_landed(folder)
    assert_whole(folder, result)


def test_the_same_seed_gives_the_same_bytes_watched_or_not_and_another_seed_others(
    fly_run: Fly, short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))

    def everything(seed: int) -> tuple[str, bytes, bytes]:
        result, folder = fly_run(seed=seed, sets=(*BRIEF, "oracles.low.stl=always (up_m >= 99)"))
        document = json.loads(to_json(result))
        del document["wall_s"]
        trajectory = (folder / "trajectory.csv").read_bytes()
        return json.dumps(document), trajectory, (folder / "real.tlog").read_bytes()

    first, other = everything(7), everything(8)
    with reading_feed() as seen:
        again = everything(7)
    assert first == again
    images = {one.name for one in seen if isinstance(one, ImageView)}
    stages = [one.word for one in seen if isinstance(one, EventView) and one.kind == "stage"]
    states = [one for one in seen if isinstance(one, RunView)]
    assert (images, stages[-1]) == ({"real", "twin", "mixed"}, "end")
    assert any(state.margins and state.mixings and len(state.vehicles) == 2 for state in states)
    # A formula that cannot hold any more is a failure in flight, though nothing flags it.
    assert (states[0].verdict_so_far, states[-1].verdict_so_far) == ("", "FAIL")
    assert states[-1].reason.startswith("low of real failed: up_m >= 99 is violated")
    assert all(one != two for one, two in zip(first, other, strict=True))


def test_sim_flies_the_twin_alone_and_judges_it(fly_run: Fly) -> None:
    result, folder = fly_run(mode="sim")
    assert result.verdict == "PASS"
    assert {oracle.vehicle for oracle in result.oracles} == {"twin"}
    assert result.mixing is None
    assert {row["vehicle"] for row in rows_of(folder)} == {"twin"}


def test_touching_the_virtual_gate_fails_and_the_flight_goes_on(fly_run: Fly) -> None:
    result, folder = fly_run(sets=("world.objects.gate.shape.gate.inner_size_m=0.31",))
    assert result.verdict == "FAIL"
    contacts = [flag for flag in result.collisions if flag.vehicle == "real"]
    assert contacts
    assert contacts[0].text.startswith("real touched gate.")
    stages = [line["stage"] for line in log_of(folder) if line["event"] == "stage"]
    assert "done" in stages
    assert all_landed(folder)


@pytest.mark.parametrize(
    ("start", "stage", "waits_s"),
    [("{on: at_height, delay_s: 0.5}", "at_height", 0.5), ("{at_s: 0.7}", "goal", 0.7)],
)
def test_a_thing_that_moves_starts_at_its_event(
    fly_run: Fly, start: str, stage: Stage, waits_s: float
) -> None:
    """A ball-like box comes down on the twin where it hovers, or flies slowly: 2.1 m at 30 m/s."""
    ram = (
        "{shape: {box: {size_m: [0.6, 0.6, 0.1]}}, pose: {up_m: 2.35}, motion: {start: "
        + start
        + ", waypoints: [{north_m: 0, east_m: 0, up_m: 0.25, speed_m_s: 30}]}}"
    )
    result, folder = fly_run(mode="sim", sets=("world.objects.ram=" + ram,))
    (contact, *_) = [flag for flag in result.collisions if "ram" in flag.text]
    entered_s = {line["stage"]: line["t_s"] for line in log_of(folder) if line["event"] == "stage"}
    assert 0.0 < contact.t_s - entered_s[stage] - waits_s < 0.07
    assert result.verdict == "FAIL"


def test_a_physical_contact_in_mode_real_stops_the_motors(fly_run: Fly) -> None:
    result, folder = fly_run(
        mode="real",
        sets=("modes=[real]", "accept=null", "world.objects.gate.shape.gate.inner_size_m=0.26"),
    )
    assert result.verdict == "FAIL"
    # By its pose it may be seen to touch a moment sooner.
    said = [result.reason, *(event.reason for event in result.also)]
    assert [text for text in said if text.startswith("real physically touched gate.")]
    assert all_landed(folder)


def test_a_vehicle_that_never_becomes_ready_is_an_error_with_its_reasons(fly_run: Fly) -> None:
    def spoil(pair: VehiclePair, _: RunState) -> None:
        cast("Any", pair.vehicles["real"]).autopilot.never_ready = True

    result, folder = fly_run(disturb=spoil, sets=(*BRIEF, "sync.ready_timeout_s=15"))
    assert result.verdict == "ERROR"
    assert result.reason.startswith("real: not ready to arm within")
    assert result.duration_s is None
    assert all_landed(folder)


@pytest.mark.parametrize("stage", ["takeoff", "goal"])
def test_a_vehicle_that_dies_in_flight_is_an_error_and_the_other_lands(
    fly_run: Fly, stage: Stage
) -> None:
    result, folder = fly_run(
        disturb=at_stage(stage, 0.5, lambda pair: cast("Any", pair.vehicles["real"]).kill()),
        sets=BRIEF,
        boots=stage == "takeoff",  # what it says by then it says at its boot
    )
    assert result.verdict == "ERROR"
    armed = "; its last STATUSTEXT: Armed by external command ("
    assert result.reason.startswith("nothing received from real for 3 s")
    assert (armed in result.reason) == (stage == "takeoff"), "later it explains nothing"
    last = {row["vehicle"]: row for row in rows_of(folder)}
    assert last["twin"]["armed"] == "0"
    assert abs(float(last["twin"]["true_down_m"])) < 0.2


def test_the_operators_abort_lands_both(fly_run: Fly) -> None:
    result, folder = fly_run(inbox=Script(9.0), sets=(*BRIEF, "autonomy.with.for_s=30"))
    assert (result.verdict, result.reason) == ("ABORTED", "aborted by tester")
    assert all_landed(folder)
    (line,) = [line for line in log_of(folder) if line["event"] == "operator"]
    assert (line["who"], line["reason"]) == ("tester", "enough seen")
    entered_s = {line.get("stage", line["event"]): line["t_s"] for line in log_of(folder)}
    assert entered_s["images_ended"] == pytest.approx(entered_s["land"] + 2.5, abs=1e-3)


def test_an_abort_while_vehicles_and_autonomies_start_ends_the_run_before_it_arms(
    fly_run: Fly,
) -> None:
    """The guard takes it by its own socket, before the run has anything that hears it."""

    def disturb(pair: VehiclePair, _: RunState) -> None:
        pair.guard.send(OperatorAction(OperatorCommand("abort", "tester", "enough seen")))

    result, folder = fly_run(sets=BRIEF, disturb=disturb)
    assert (result.verdict, result.reason) == ("ABORTED", "aborted by tester")
    assert {line.get("stage") for line in log_of(folder)}.isdisjoint({"arm", "ready"})


def test_a_fence_that_is_left_brings_both_down_and_fails(fly_run: Fly) -> None:
    result, folder = fly_run(
        sets=(*BRIEF, "autonomy.with.for_s=6", "geofence.box.north_m=[-0.8, 3.2]")
    )
    assert result.verdict == "FAIL"
    assert "fence" in result.reason
    assert all_landed(folder)


@pytest.mark.parametrize(
    ("sets", "inbox", "outcome"),
    [
        (
            ("autonomy.with.for_s=6", "geofence.box.north_m=[-0.8, 3.2]"),
            None,
            ("FAIL", "twin cannot stop before the fence's north side"),
        ),
        (("autonomy.with.for_s=30",), Script(9.0), ("ABORTED", "aborted by tester")),
    ],
)
def test_a_live_feed_that_raises_hides_nothing_that_the_guard_decides(
    fly_run: Fly,
    monkeypatch: pytest.MonkeyPatch,
    sets: tuple[str, ...],
    inbox: Script | None,
    outcome: tuple[str, str],
) -> None:
    def guard(_: ConsoleFeed, event: GuardEvent) -> None:
        raise RuntimeError(f"cannot show {event.kind}")

    monkeypatch.setattr(ConsoleFeed, "guard", guard)
    result, folder = fly_run(mode="sim", sets=(*BRIEF, *sets), inbox=inbox)
    verdict, cause = outcome
    assert result.verdict == verdict, result.reason
    assert cause in result.reason
    assert all_landed(folder)
    assert result.exceptions == ()
    (ended,) = result.views_ended
    assert ended.startswith("console: RuntimeError: cannot show ")


@pytest.mark.parametrize(
    "call",
    ["__init__", "__enter__", "__exit__", "attach", "tick", "shown", "stage", "vehicle_event"],
)
def test_a_live_feed_that_raises_ends_and_the_flight_goes_on(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    """It made the run an ERROR, and landed both vehicles."""

    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("no screen")

    monkeypatch.setattr(ConsoleFeed, call, fail)
    result, folder = fly_run(mode="sim", sets=BRIEF)
    assert (result.verdict, result.exceptions) == ("PASS", ()), result.reason
    assert result.views_ended == ("console: RuntimeError: no screen",)
    (line,) = [line for line in log_of(folder) if line["event"] == "live feed"]
    assert line["fault"] == "console: RuntimeError: no screen"
    (caveat,) = [one for one in campaign_caveats([result]) if "view" in one]
    assert caveat.startswith("live view ended early: console: RuntimeError: no screen")


def test_motors_that_stop_in_the_air_of_a_landing_are_no_landing(fly_run: Fly) -> None:
    """PX4 reports the ground of any disarmed vehicle, before its HEARTBEAT comes."""

    def stop(pair: VehiclePair) -> None:
        embedded: Any = pair.vehicles["real"]
        embedded.autopilot.stop_motors("a test")

    sets = (*BRIEF, "goal.altitude_m=1.3", "oracles.touchdown.max_m_s=10")
    result, _ = fly_run(disturb=at_stage("land", 0.15, stop), sets=sets)
    assert result.verdict == "FAIL"
    assert "real: disarmed in flight" in result.reason


class Reckless:
    """Flies north as fast as it can, for ever."""

    def __init__(self, **_: object) -> None:
        pass

    def perceive(self, reading: Reading) -> None:
        pass

    def act(self, telemetry: Telemetry) -> Command:
        return Command(VelocitySetpoint((6.0, 0.0, -1.0)))


@pytest.mark.parametrize("campaign", ["gate", "gate-ardupilot"])
def test_limits_keep_a_reckless_autonomy_inside_of_the_fence(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch, campaign: str
) -> None:
    monkeypatch.setattr(
        "wil_campaign.campaigns.setup.autonomy_under_test.find_autonomy", lambda *_: Reckless
    )
    limits = "limits={inside_geofence: true, up_m: [0, 2.2], acceleration_m_s2: 3, speed_m_s: 2}"
    result, folder = fly_run(
        campaign,
        sets=(
            limits,
            "oracles.time_limit.limit_s=12",
            "collision_always=off",
            "oracles.collision.required=false",
            "oracles.reached.required=false",
        ),
    )
    assert result.reason == "real was not done 12 s after its goal"
    fence = next(o for o in result.oracles if (o.name, o.vehicle) == ("geofence", "real"))
    assert fence.verdict == "PASS"
    said = [line["text"] for line in log_of(folder) if line.get("kind") == "limited"]
    for what in ("speed", "acceleration", "speed towards the fence"):
        assert any(text.startswith(f"real: {what} limited from") for text in said)
    rows = [row for row in rows_of(folder) if row["vehicle"] == "real" and row["true_north_m"]]
    north_m = [float(row["true_north_m"]) for row in rows]
    assert 3.0 < max(north_m) < 4.8
    assert all_landed(folder)


def test_a_crash_of_the_autonomy_is_a_fail_with_its_place(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Crashing:
        def __init__(self, **_: object) -> None:
            pass

        def perceive(self, reading: Reading) -> None:
            pass

        def act(self, telemetry: Telemetry) -> Command:
            raise ZeroDivisionError("one half of nothing")

    monkeypatch.setattr(
        "wil_campaign.campaigns.setup.autonomy_under_test.find_autonomy", lambda *_: Crashing
    )
    result, folder = fly_run()
    assert result.verdict == "FAIL"
    assert "the autonomy of" in result.reason
    assert "ZeroDivisionError" in result.reason
    assert "test_run.py" in result.reason
    assert all_landed(folder)


def test_an_autonomy_that_never_ends_runs_into_the_time_limit(fly_run: Fly) -> None:
    result, folder = fly_run(sets=("oracles.time_limit.limit_s=2",))
    assert result.verdict == "FAIL"
    assert result.reason.startswith("reached of real failed: never flew through gate")
    assert any("not done 2 s after its goal" in late.reason for late in result.also)
    assert all_landed(folder)


@pytest.mark.parametrize("stream", ["JudgeLogWriter", "TlogWriter", "RunLog"])
def test_a_full_disk_lands_the_flight_and_is_an_error(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch, stream: str
) -> None:
    writer = getattr(run_recorder, stream)
    write = writer.write

    def until_full(self: Any, *args: Any, **details: Any) -> None:
        if asyncio.get_running_loop().time() > 6.0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(self, *args, **details)

    monkeypatch.setattr(writer, "write", until_full)
    result, folder = fly_run(mode="sim", sets=BRIEF)
    assert result.verdict == "ERROR"
    assert result.reason == "the recording ended early: No space left on device"
    (landed,) = [oracle for oracle in result.oracles if oracle.name == "landed"]
    assert landed.verdict == "PASS"
    assert (folder / "trajectory.csv").exists()


def test_a_disk_that_fills_up_in_flight_is_no_exception_of_ours(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever writes learns it later."""
    full, put = threading.Event(), BackgroundFile._put

    def refused(self: BackgroundFile, data: bytes) -> bool:
        if not full.is_set():
            return put(self, data)
        self._error = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return False

    monkeypatch.setattr(BackgroundFile, "_put", refused)
    filling = at_stage("goal", 0.0, lambda _: full.set())
    result, _ = fly_run(mode="sim", sets=BRIEF, disturb=filling)
    assert result.verdict == "ERROR"
    assert result.reason == "the recording ended early: No space left on device"
    assert result.exceptions == ()
    assert "trajectory.csv" in result.artifacts


@pytest.mark.parametrize("is_full", [False, True])
def test_a_run_whose_recording_is_cut_off_at_its_end_proves_nothing(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch, is_full: bool
) -> None:
    """The disk takes the last of run.mcap never, or refuses it; no message counts as lost."""
    finish, reached, released = ChunkedFile.finish, threading.Event(), threading.Event()

    def last(self: ChunkedFile, metadata: dict[str, str]) -> None:
        if is_full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        reached.set()
        assert released.wait(60.0)
        finish(self, metadata)

    class Brief(DiskPatience):
        def waits_on(self, polls: int, *, is_brief: bool = False) -> bool:
            return not reached.is_set()

    monkeypatch.setattr(ChunkedFile, "finish", last)
    monkeypatch.setattr(mcap_writer, "patience", Brief())
    result, _ = fly_run(mode="sim", sets=BRIEF)
    released.set()
    why = "run.mcap: No space left on device; recording ended" if is_full else "the disk takes"
    assert result.verdict == "INVALID"
    assert result.reason.startswith(f"run.mcap is cut off ({why}")


def test_a_disk_that_stands_still_in_flight_delays_nothing_and_loses_nothing(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, before = fly_run(mode="sim", sets=BRIEF)
    released, put = threading.Event(), BackgroundFile._put

    def stalled(self: BackgroundFile, data: bytes) -> bool:
        return released.wait(60.0) and put(self, data)

    monkeypatch.setattr(BackgroundFile, "_put", stalled)
    monkeypatch.setattr(run_log, "_WRITTEN_WITHIN_S", 0.05)
    seen: list[bool] = []

    def release(_: Any) -> None:
        seen.append(released.is_set())
        released.set()

    result, folder = fly_run(mode="sim", sets=BRIEF, disturb=at_stage("landed", 0.0, release))
    assert (result.verdict, seen) == ("PASS", [False]), result.reason
    assert all_landed(folder)
    for name in ("judged.msgpack", "log.jsonl", "trajectory.csv", "twin.tlog"):
        assert (folder / name).read_bytes() == (before / name).read_bytes()


@pytest.mark.parametrize(
    "take", [shutil.rmtree, lambda folder: shutil.move(folder, folder.with_name("moved"))]
)
def test_a_folder_that_somebody_removes_in_flight_lands_it_and_is_an_error(
    fly_run: Fly, tmp_path: Path, take: Callable[[Path], None]
) -> None:
    """What is written into removed files is lost, and no system call says so."""
    removing = at_stage("goal", 0.5, lambda _: take(tmp_path / "run1"))
    result, folder = fly_run(mode="sim", sets=BRIEF, disturb=removing)
    assert result.verdict == "ERROR"
    assert result.reason == f"the recording ended early: {folder} was removed or moved"
    assert (result.exceptions, result.artifacts) == ((), ())
    (landed,) = [oracle for oracle in result.oracles if oracle.name == "landed"]
    assert landed.verdict == "PASS"


def test_an_autonomy_that_never_ends_has_a_time_out_whatever_is_judged(fly_run: Fly) -> None:
    result, folder = fly_run(
        mode="sim",
        sets=("oracles={reached: {}}", "sync.goal_timeout_s=2", "accept=null"),
    )
    assert result.verdict == "FAIL"
    assert result.reason.startswith("reached of twin failed: never flew through gate")
    late = "the autonomy of twin was not done 2 s after its goal (sync.goal_timeout_s)"
    assert late in [one.reason for one in result.also]
    assert all_landed(folder)


def test_a_contact_fails_the_run_of_a_campaign_that_does_not_ask(fly_run: Fly) -> None:
    result, _ = fly_run(
        mode="sim",
        sets=(
            "oracles={reached: {}}",
            "world.objects.gate.shape.gate.inner_size_m=0.26",
        ),
    )
    assert result.verdict == "FAIL"
    assert result.reason.startswith("twin touched gate.")
    assert [flag.oracle for flag in result.collisions][:1] == ["collision_always"]


@pytest.mark.parametrize(("fast", "last"), [("true", "takeoff"), ("false", "landed")])
def test_an_oracle_lands_the_run_at_once_where_the_campaign_says(
    fly_run: Fly, fast: str, last: str
) -> None:
    limit = f"oracles.altitude={{max_m: 0.6, fail_fast: {fast}}}"
    result, folder = fly_run(sets=(*BRIEF, "goal.altitude_m=0.8", limit))
    assert result.verdict == "FAIL"
    assert result.reason.startswith("real is at a height of 0.6")
    stages = [line["stage"] for line in log_of(folder) if line["event"] == "stage"]
    assert ("goal" in stages) is (last == "landed")
    assert all_landed(folder)


def test_a_formula_that_cannot_hold_any_more_lands_the_run(fly_run: Fly) -> None:
    formula = "oracles.low={stl: 'always (up_m < 0.6)', from: takeoff, fail_fast: true}"
    result, folder = fly_run(sets=(*BRIEF, "goal.altitude_m=0.8", formula))
    assert result.verdict == "FAIL"
    assert "low cannot be satisfied any more" in result.reason
    assert "goal" not in [line.get("stage") for line in log_of(folder)]
    (judged,) = [o for o in result.oracles if o.name == "low" and o.vehicle == "real"]
    assert judged.verdict == "FAIL"
    assert judged.margin is not None
    assert judged.margin < 0.0
    assert all_landed(folder)


def test_a_flight_that_is_interrupted_twice_leaves_no_thread_and_whole_files(
    fly_run: Fly, tmp_path: Path
) -> None:
    """The second interrupt breaks off the landing that the first one began."""

    def interrupt(_: VehiclePair, __: RunState) -> None:
        def interrupted() -> None:
            raise KeyboardInterrupt

        for at_s in (6.0, 6.1):
            asyncio.get_running_loop().call_later(at_s, interrupted)

    before = set(threading.enumerate())  # of other tests' flights
    with pytest.raises(KeyboardInterrupt):
        fly_run(mode="sim", sets=BRIEF, disturb=interrupt)
    own = [one for one in threading.enumerate() if one not in before]
    assert [one.name for one in own if str(tmp_path) in one.name] == []
    writers = [one for one in own if one.name.startswith(("writer", "recorder"))]
    for writer in writers:
        writer.join(10.0)
    assert [one.name for one in writers if one.is_alive()] == []
    recording = RecordStream(tmp_path / "run1" / "run.mcap")
    assert list(recording)
    assert recording.end is not None
    assert recording.end.whole
