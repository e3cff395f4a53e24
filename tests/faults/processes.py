"""Seeded faults of real processes of a flight under the wall clock.

`python -m tests.faults.processes FIRST COUNT FOLDER` prints one JSON object for each signal to a
process; `python -m tests.faults.processes FIRST COUNT FOLDER troubles` for each other trouble.
"""

import asyncio
import hashlib
import json
import os
import re
import shutil
import signal
import sys
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

from tests.faults.barriers import acted_after_s, late
from tests.faults.environment import Around, environment, place_for_results, trouble
from tests.faults.inspection import all_gone, roles, truth_receiver
from tests.faults.readable import read_lines, unreadable
from tests.faults.real_draws import ALWAYS_FLIES, RealFault, draw_signal, draw_trouble
from tests.faults.socket_ledger import files_left, socket_ledger, start_again
from tests.faults.witness import Sight, Witness
from tests.orchestrator.wall_runs import ROOT, Program, stages
from wil_campaign.foundation.processes.identity import ProcessId

_INSIDE = Path(__file__).parent / "inside"
_STOPPED_S = 12.0
_STAGE_WITHIN_S = 120.0
_GONE_WITHIN_S = 200.0
_ACTS_WITHIN_S = {
    ("orchestrator", "SIGKILL"): 3.0,
    ("flight", "SIGKILL"): 1.0,
    ("real", "SIGKILL"): 1.0,
    ("flight", "SIGSTOP"): 2.0,
    ("real", "SIGSTOP"): 4.5,
}
"""After what in the air the guard has to take over, and how soon on a machine that is busy."""
_VERDICTS = {"PASS", "FAIL", "INVALID", "ERROR", "ABORTED"}


@dataclass(frozen=True, slots=True)
class RealAftermath:
    """What came of it; hit: whether it could be done at all; verdict: None without a result.

    acted_s: how long after it the guard took over. sockets: that its processes held, in all.
    swept: files of killed processes that lay there until a next start.
    """

    fault: RealFault
    hit: bool
    verdict: str | None
    reason: str
    exit_code: int | None
    acted_s: float | None
    lost: tuple[str, ...]
    sockets: int = 0
    swept: int = 0


class FaultyProgram(Program):
    """The program with the harness's own eyes in its processes."""

    def __init__(
        self, out: Path, *arguments: str, step: Path, truth_port: int, clock: str = "wall"
    ) -> None:
        super().__init__(out, *arguments, clock=clock)
        self.step = step
        self._truth_port = truth_port
        self._temporary = self.runtime / "tmp"
        self._temporary.mkdir()

    @property
    def environment(self) -> dict[str, str]:
        return {
            **super().environment,
            "PYTHONPATH": os.pathsep.join((str(_INSIDE), str(ROOT))),
            "TMPDIR": str(self._temporary),
            "WIL_FAULTS_STEP": str(self.step),
            "WIL_FAULTS_PORT": str(self._truth_port),
        }


@dataclass(slots=True)
class Flown:
    """A flight when all is over."""

    fault: RealFault
    folder: Path | None
    code: int | None
    err: str
    left: list[str]
    struck_s: float | None
    armed_then: tuple[str, ...]
    sights: Mapping[str, Sight]
    victim: ProcessId | None = None
    sockets: int = 0
    swept: int = 0


async def inject(fault: RealFault, folder: Path, finished: Path | None = None) -> RealAftermath:
    """Fly a run with a fault in it, and return what came of it; the folder is there.

    finished: a campaign's folder with a run that ended before; it is taken up, and kept intact.
    """
    with place_for_results(fault, folder) as out:
        mode: tuple[str, ...] = ("--mode", "wil")
        if finished is not None and fault.victim != "read-only from the start":
            shutil.copytree(finished, out / "gate" / finished.name)
            mode = ("--resume",)
        before = _hashes(out)
        async with environment(fault, folder) as around, truth_receiver() as (truth, port):
            arguments = (*mode, "--json", *around.arguments)
            step = folder / "clock-step"
            async with (
                FaultyProgram(out, *arguments, step=step, truth_port=port) as program,
                socket_ledger(program.runtime) as ledger,
            ):
                flown = await _flown(fault, program, around, truth.sights)
                flown.sockets = len(ledger.seen)
                flown.left += [f"{one} is left" for one in ledger.left()]
                swept, left = own_files(program.runtime, flown.victim)
                flown.swept = len(swept)
                flown.left += [f"{one} is left" for one in left]
        return _aftermath(flown, before)


async def _flown(
    fault: RealFault, program: FaultyProgram, around: Around, sights: Mapping[str, Sight]
) -> Flown:
    """Have it fly, hit it, and wait until all is over."""
    with ExitStack() as stack:
        hit = await _due(fault, program)
        struck_s, armed_then, victim = None, tuple[str, ...](), None
        if hit:
            armed_then = tuple(name for name, sight in sights.items() if sight.armed)
            pids = {**roles(program.process.pid, program.runtime), **around.pids}
            if fault.action == "trouble":
                struck_s = asyncio.get_running_loop().time()
                await trouble(fault, program, around, program.step, stack)
            else:
                hit = fault.victim in pids and pids[fault.victim].lives
                struck_s = asyncio.get_running_loop().time() if hit else None
                victim = pids.get(fault.victim)
                await _signal(fault, pids)
        try:
            landed = await program.end(_GONE_WITHIN_S)
            code: int | None = landed.code
            err = landed.err
        except TimeoutError:
            code, err = program.process.returncode, "its output did not end"
        gone = await all_gone(program.runtime, _GONE_WITHIN_S if code is None else 60.0)
        left = [f"{pid} lives still: {words[:80]}" for pid, (_, words) in gone.items()]
        for pid in gone:
            os.kill(pid, signal.SIGKILL)
    folders = list((program.out / "gate").glob("*")) if (program.out / "gate").is_dir() else []
    folder = folders[0] if folders else None
    return Flown(fault, folder, code, err, left, struck_s, armed_then, sights, victim)


def own_files(runtime: Path, victim: ProcessId | None) -> tuple[list[str], list[str]]:
    """Return the victim's files, which a next start removes, and those that nobody does.

    A process that is killed removes nothing: its own files are the only ones that may lie there.
    """
    own = "" if victim is None else f"-{victim.pid}"
    found = files_left(runtime)
    of_victim = {one for one in found if own and re.search(rf"{own}(?!\d)", one)}
    start_again(runtime)
    after = set(files_left(runtime))
    left = [one for one in found if one not in of_victim or one in after]
    return sorted(of_victim - after), left


async def _due(fault: RealFault, program: FaultyProgram) -> bool:
    """Wait for the moment; return whether it came."""
    if fault.victim == "read-only from the start":
        return False
    arrived = asyncio.create_task(program.stage(fault.stage, timeout_s=_STAGE_WITHIN_S))
    ended = asyncio.create_task(program.process.wait())
    await asyncio.wait((arrived, ended), return_when=asyncio.FIRST_COMPLETED)
    came = arrived.done() and arrived.exception() is None
    for task in (arrived, ended):
        task.cancel()
    if came:
        await asyncio.sleep(fault.after_s)
    return came


async def _signal(fault: RealFault, pids: Mapping[str, ProcessId]) -> None:
    victim = pids.get(fault.victim)
    if victim is None or not victim.lives:
        return
    os.kill(victim.pid, getattr(signal, fault.action))
    if fault.action == "SIGSTOP":
        await asyncio.sleep(_STOPPED_S)
        if victim.lives:
            os.kill(victim.pid, signal.SIGCONT)


def _aftermath(flown: Flown, before: Mapping[str, str]) -> RealAftermath:
    fault, lost = flown.fault, list(flown.left)
    verdict, reason = None, ""
    if fault.victim == "read-only from the start":
        if flown.code != 3 or "cannot be written" not in flown.err or flown.sights:
            lost.append(f"exit {flown.code}: {flown.err[-300:]}")
        return RealAftermath(fault, True, None, flown.err.strip(), flown.code, None, tuple(lost))
    if flown.folder is None:
        lost.append("no folder")
        return RealAftermath(fault, False, None, flown.err, flown.code, None, tuple(lost))
    run = flown.folder / "large" / "wil" / "1"
    lost += unreadable(run)
    lost += _not_intact(flown.folder, before)
    if (run / "result.json").exists():
        result = json.loads((run / "result.json").read_text("utf-8"))
        verdict, reason = result["verdict"], result["reason"]
    lost += _of_summary(flown, verdict)
    lost += _of_verdict(flown, verdict, reason, run)
    lost += _not_down(flown)
    if "Traceback" in flown.err:
        lost.append(f"a traceback: {flown.err[-400:]}")
    events = [
        (float(str(log_line["t_s"])), str(log_line.get("kind"))) for log_line in _log_lines(run)
    ]
    acted_s = acted_after_s(events, flown.struck_s)
    then = [name for name in flown.armed_then if name != fault.victim]
    others = {name: flown.sights[name] for name in then}
    if fault.victim in flown.sights and fault.victim not in flown.armed_then:
        others = {}
    within_s = _ACTS_WITHIN_S.get((fault.victim, fault.action))
    lost += late(acted_s, within_s, flown.struck_s, others)
    hit = flown.struck_s is not None
    return RealAftermath(
        fault, hit, verdict, reason, flown.code, acted_s, tuple(lost), flown.sockets, flown.swept
    )


def _not_down(flown: Flown) -> list[str]:
    """Return who does not stand on the ground, disarmed, by the physics of its own process."""
    gone = {flown.fault.victim} if flown.fault.action != "trouble" else set[str]()
    found = [f"nobody saw {name}" for name in {"real", "twin"} - flown.sights.keys()]
    for name, sight in flown.sights.items():
        if name not in gone and not sight.down:
            found.append(f"{name} ended armed {sight.armed}, {sight.up_m:.2f} m up")
        if name not in gone and sight.fell:
            found.append(f"{name} fell: {sight.sink_m_s:.1f} m/s")
    return found


def _of_summary(flown: Flown, verdict: str | None) -> list[str]:
    assert flown.folder is not None
    try:
        summary = json.loads((flown.folder / "summary.json").read_text("utf-8"))
    except (OSError, ValueError) as error:
        return [f"summary.json: {error}"]
    runs = {f"{one['case']}/{one['mode']}/{one['rep']}": one for one in summary["runs"]}
    said = runs.get("large/wil/1", {}).get("verdict")
    if said is not None and verdict is not None and said != verdict:
        return [f"summary.json says {said}, result.json {verdict}"]
    if said == "PASS" and verdict is None:
        return ["summary.json says PASS, and there is no result.json"]
    if (flown.folder / "large" / "sim").exists() and runs["large/sim/1"]["verdict"] != "PASS":
        return ["the finished run is not in summary.json as it was"]
    return []


def _of_verdict(flown: Flown, verdict: str | None, reason: str, run: Path) -> list[str]:
    """Return what is wrong with what was said of the run."""
    found, fault = [], flown.fault
    if verdict is not None and verdict not in _VERDICTS:
        found.append(f"verdict {verdict}")
    if verdict == "PASS":
        witness = Witness({})
        witness.sights = dict(flown.sights)
        gone = "twin" if fault.victim == "twin" else ""
        found += [f"PASS, though {what}" for what in witness.not_completed(but=gone)]
        if not {"done", "landed"} <= set(stages(run)):
            found.append("PASS of a flight that was not completed")
    elif verdict is not None and not reason:
        found.append(f"{verdict} without a reason")
    if fault.victim in ALWAYS_FLIES and verdict != "PASS":
        found.append("it should not have disturbed the flight")
    nobody_left = fault.victim in {"orchestrator", "flight"} or "only" in fault.victim
    if verdict is None and not (nobody_left or "disk" in fault.victim):
        found.append("no result.json")
    told = (flown.code == 3 and flown.err) or any(
        log_line["event"] == "guard" for log_line in _log_lines(run)
    )
    if verdict is None and not told and any(sight.flew for sight in flown.sights.values()):
        found.append("nobody says what happened")
    if flown.code == 0 and verdict != "PASS":
        found.append("exit 0 without a PASS")
    return found


def _log_lines(run: Path) -> list[dict[str, object]]:
    return read_lines(run / "guard.jsonl") if (run / "guard.jsonl").exists() else []


def _hashes(out: Path) -> dict[str, str]:
    """Return the content of the runs that were finished before."""
    return {
        str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(out.glob("gate/*/large/sim/**/*"))
        if path.is_file()
    }


def _not_intact(folder: Path, before: Mapping[str, str]) -> list[str]:
    after = _hashes(folder.parents[1])
    return [
        f"{name} of a finished run changed"
        for name, was in before.items()
        if after.get(name) != was
    ]


async def one_finished(folder: Path) -> Path:
    """Fly mode sim to its end and cut the campaign off; return its folder, to be taken up."""
    async with truth_receiver() as (_, port):
        step = folder / "clock-step"
        async with FaultyProgram(folder / "out", "--json", step=step, truth_port=port) as program:
            await program.stage("identify", timeout_s=_STAGE_WITHIN_S)
            program.process.send_signal(signal.SIGTERM)
            await program.end(_GONE_WITHIN_S)
            shutil.rmtree(program.folder / "large" / "wil")
            return program.folder


def main(arguments: list[str]) -> None:
    first, count = int(arguments[0]), int(arguments[1])
    folder = Path(arguments[2])
    draw = draw_trouble if arguments[3:] == ["troubles"] else draw_signal
    (folder / f"finished-{first}").mkdir(parents=True)
    finished = asyncio.run(one_finished(folder / f"finished-{first}"))
    for seed in range(first, first + count):
        fault, own = draw(seed), folder / f"{arguments[3:]}-{seed}"
        own.mkdir(parents=True)
        # With other options it would be another campaign.
        usual = fault.victim not in {"broker", "source", "autonomy", "garbage by MQTT"}
        aftermath = asyncio.run(inject(fault, own, finished if usual else None))
        sys.stdout.write(json.dumps(asdict(aftermath)) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
