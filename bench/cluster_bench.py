"""A campaign on a bench and one over both hosts, killed in flight and resumed: their ledgers.

The bench is on the second host, served on a terminal; an embedded vehicle behind a socket is its
hardware, and flies with a twin. The campaigns' programs are on the first host.
"""

import json
import os
import pty
import random
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import psutil

from bench.cluster_files import WORLD, write_campaign
from bench.cluster_hosts import STARTED_S, Host, cluster_of, two_hosts, wait_for

BENCH_VICTIMS = ["both programs", "bench server", "bench raylet"]
BENCH = """\
schema: wil/bench/1
bench: hall-a
properties: {indoor: true}
vehicles:
  real:
    link: udpin://127.0.0.1:14540
    autopilot: px4
    sensors: {camera: {type: camera, rate_hz: 5, width_px: 80, height_px: 60, fov_deg: 69}}
geofence: {box: {north_m: [-9, 9], east_m: [-9, 9], up_m: [-2, 5]}}
"""
HALL = """\
schema: wil/campaign/1
campaign: hall
bench: hall-a
vehicles:
  twin:
    link: embedded
    autopilot: px4
    sensors: {camera: {type: camera, rate_hz: 5, width_px: 80, height_px: 60, fov_deg: 69}}
world: world.yaml
recipe: recipe.yaml
autonomy: {use: still.py:Still, with: {ticks: 300}}
goal: {altitude_m: 1.2}
modes: [wil]
preflight: {failsafe: set}
oracles: {landed: {}, geofence: {}}
"""
RECIPE = """\
schema: wil/recipe/1
sensors: {camera: {type: camera, rate_hz: 5}}
combine:
  - sensor: camera
    merge: {overlay: {priority: [real, twin]}}
    publish: [real, twin]
    max_skew_ms: 900
"""
RUNS = {"hover": 6, "hall": 3}
DOWN_S = 120.0
TICKS = 2000
"""Of a flight over both nodes: long enough that some are in flight when the bench's second is."""
_STAYS = "vehicle px4"
"""What flies nothing by itself: the hardware."""


def account(folder: Path, victim: str, seed: int) -> bool:
    """Kill in flight, resume, print both ledgers; return whether all is accounted for."""
    folder.mkdir(parents=True)
    hover = write_campaign(folder, ticks=TICKS)
    (folder / "hall.yaml").write_text(HALL)
    (folder / "hall-a.yaml").write_text(BENCH)
    (folder / "recipe.yaml").write_text(RECIPE)
    (folder / "world.yaml").write_text(WORLD)
    out = folder / "out"
    with ExitStack() as stack:
        first, second = stack.enter_context(two_hosts(folder))
        engine = ("--engine", f"ray://{stack.enter_context(cluster_of(first, second, (1, 1)))}")
        vehicle = second.program("vehicle", "px4", "--link", "udpout://127.0.0.1:14540")
        second.start("vehicle", *vehicle)
        server = stack.enter_context(_served(second, folder / "hall-a.yaml", *engine))

        def command(file: Path, *more: str) -> list[str]:
            count = str(RUNS[file.stem])
            words = ("run", str(file), "--out", str(out), "--repetitions", count, *engine)
            return first.program(*words, *more)

        programs = {"hall": first.start("hall", *command(folder / "hall.yaml"))}
        wait_for(lambda: _has_begun(out, 1), STARTED_S, "the first run on the bench")
        programs["hover"] = first.start("hover", *command(hover))
        wait_for(lambda: _has_begun(out, 2), STARTED_S, "the second run on the bench")
        wait_for(lambda: _ordered(out) > 0, STARTED_S, "a run over both nodes")
        time.sleep(random.Random(seed).uniform(0.0, 4.0))  # noqa: S311
        print(f"{victim}, seed {seed}: {_ordered(out)} runs of hover in flight", flush=True)
        began_s = time.monotonic()
        _kill(victim, programs, server, second)
        wait_for(lambda: not _flies(out), DOWN_S, "the landing")
        down_s = time.monotonic() - began_s
        codes = {name: program.wait(STARTED_S) for name, program in programs.items()}
        print(f"exit codes {codes}, bench down after {down_s:.0f} s; {_down(out)}", flush=True)
        if victim != "both programs":
            with suppress(psutil.TimeoutExpired):
                server.wait(60)
            stack.enter_context(_served(second, folder / "hall-a.yaml", *engine))
        fine = _resume(first, folder, command, hover)
        left = [*first.flying(), *second.flying()]
        lines = [_line(one) for one in left]
        names = [line[:100] for line in lines if _STAYS not in line]
        print(f"processes left: {names or 'none'}", flush=True)
        for name in RUNS:
            _show_ledger(out, name)
        return fine and not names


def _resume(first: Host, folder: Path, command: Callable[..., list[str]], hover: Path) -> bool:
    """Resume both campaigns; return whether each run has come to its end."""
    over = first.run(*command(hover, "--resume"))
    print(f"hover resumed: exit code {over.returncode}, {_verdicts(folder / 'out', 'hover')}")
    hall = folder / "hall.yaml"
    ended = first.run(*command(hall, "--resume"))
    verdicts = _verdicts(folder / "out", "hall")
    print(f"hall resumed: exit code {ended.returncode}, {verdicts}", flush=True)
    again = [run for run, verdict in verdicts.items() if verdict != "PASS"]
    named = [word for run in again for word in ("--again", run)]
    last = first.run(*command(hall, "--resume", *named))
    verdicts = _verdicts(folder / "out", "hall")
    print(f"hall with --again {again}: exit code {last.returncode}, {verdicts}", flush=True)
    if last.returncode:
        print(ended.stderr[-1500:], last.stderr[-1500:], flush=True)
    return bool(over.returncode == last.returncode == 0 and len(verdicts) == RUNS["hall"])


def _kill(
    victim: str,
    programs: dict[str, "subprocess.Popen[bytes]"],
    server: psutil.Process,
    second: Host,
) -> None:
    if victim == "both programs":
        for program in programs.values():
            program.kill()  # nsenter has become our program: one process
    elif victim == "bench server":
        server.kill()
    else:
        raylets = [process for process in second.processes() if "raylet/raylet" in _line(process)]
        max(raylets, key=lambda one: one.create_time()).kill()


@contextmanager
def _served(host: Host, file: Path, *engine: str) -> Iterator[psutil.Process]:
    """Serve a bench on a terminal of its own, at which somebody consents to everything."""
    pid, terminal = pty.fork()
    words = host.command(*host.program("bench", "serve", str(file), *engine))
    if pid == 0:
        os.execvpe(words[0], words, host.environment_of_programs())  # noqa: S606
    shown = host.logs / f"bench-terminal-{pid}.log"
    shown.touch()

    def consent() -> None:
        with shown.open("ab", buffering=0) as stream, suppress(OSError):
            while text := os.read(terminal, 4096):
                stream.write(text)
                if b"take off? [y/N]" in text:
                    os.write(terminal, b"y\n")

    threading.Thread(target=consent, daemon=True).start()
    process = psutil.Process(pid)
    try:
        wait_for(lambda: "Ctrl-C ends it" in shown.read_text(), STARTED_S, "the bench")
        yield process
    finally:
        with suppress(psutil.Error):
            process.terminate()
            process.wait(60)
        with suppress(OSError):
            os.close(terminal)


def _newest(out: Path, name: str) -> Path | None:
    return max(out.glob(f"{name}/*"), default=None)


def _has_begun(out: Path, run: int) -> bool:
    """Return whether a run of the bench has received the command to take off."""
    folder = _newest(out, "hall")
    log = None if folder is None else folder / f"default/wil/{run}/log.jsonl"
    return log is not None and log.is_file() and '"takeoff"' in log.read_text()


def _ordered(out: Path) -> int:
    """Return how many runs over both nodes are ordered and have no outcome."""
    folder = _newest(out, "hover")
    ledger = None if folder is None else folder / "ledger.jsonl"
    if ledger is None or not ledger.is_file():
        return 0
    events = Counter(json.loads(line)["event"] for line in ledger.read_text().splitlines())
    return events["ordered"] - events["ended"] - events["lost"] - events["found"]


def _flies(out: Path) -> bool:
    """Return whether a run on the bench is without its end still."""
    folder = _newest(out, "hall")
    if folder is None:
        return False
    runs = [path.parent for path in folder.glob("default/wil/*/log.jsonl")]
    return any(not (run / "result.json").is_file() for run in runs)


def _down(out: Path) -> str:
    """Return what the guards say of the vehicles of the run that was in flight."""
    folder = _newest(out, "hall")
    log = None if folder is None else folder / "default/wil/2/guard.jsonl"
    if log is None or not log.is_file():
        return "no guard"
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    ends = [line for line in lines if line.get("vehicle") and "down" in json.dumps(line)]
    return ", ".join(str(line.get("text") or line) for line in ends[-2:]) or str(lines[-2:])


def _verdicts(out: Path, name: str) -> dict[str, str]:
    folder = _newest(out, name)
    if folder is None:
        return {}
    runs = json.loads((folder / "summary.json").read_text())["runs"]
    return {f"{run['case']}/{run['mode']}/{run['rep']}": run["verdict"] for run in runs}


def _show_ledger(out: Path, name: str) -> None:
    """Print what the ledger has of each run."""
    folder = _newest(out, name)
    if folder is None:
        return
    lines = [json.loads(line) for line in (folder / "ledger.jsonl").read_text().splitlines()]
    starts = [line["session"] for line in lines if line["event"] == "begun"]
    print(f"ledger of {name}: {dict(Counter(line['event'] for line in lines))}")
    for line in lines:
        start = starts.index(line["session"]) + 1
        words = (line["event"], line.get("run", ""), line.get("node", ""), line.get("text", ""))
        print(f"  start {start}: {' | '.join(one for one in words if one)}", flush=True)


def _line(process: psutil.Process) -> str:
    with suppress(psutil.Error):
        return " ".join(process.cmdline())
    return ""
