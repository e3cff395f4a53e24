"""What a campaign over two hosts survives: a victim ended by SIGKILL in flight, then a resumption.

The autonomy writes down each of its flights, on a disk that both hosts have: that counts, whatever
ledger and results say. Even seeds share a folder for the store, odd ones have S3.
"""

import json
import os
import random
import re
import subprocess
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import psutil

from bench.cluster_files import WORLD
from bench.cluster_hosts import Host, cluster_of, start_store, two_hosts, wait_for

CAMPAIGN = """\
schema: wil/campaign/1
campaign: hover
vehicles: {twin: {link: embedded, autopilot: px4}}
world: world.yaml
autonomy: {use: still.py:Still, with: {ticks: 2000}}
goal: {altitude_m: 1.2}
modes: [sim]
oracles: {landed: {}}
"""
STILL = """\
import os, platform, time
from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.setpoints import VelocitySetpoint


class Still:
    def __init__(self, *, goal, parameters, seed):
        self.ticks, self.flights = parameters["ticks"], os.environ["WIL_BENCH_FLIGHTS"]
        self.run = ""

    def write(self, what):
        handle = os.open(self.flights, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.write(handle, f"{time.time():.3f} {what} {self.run} {platform.node()}\\n".encode())
        os.close(handle)

    def perceive(self, reading):
        pass

    def act(self, telemetry):
        if not self.run:
            # What a run prints goes to its folder, .../default/sim/1/output.txt.
            self.run = "/".join(os.readlink("/proc/self/fd/1").split("/")[-4:-1])
            self.write("begin")
        self.ticks -= 1
        if self.ticks == 0:
            self.write("end")
        return Command(VelocitySetpoint((0.0, 0.0, 0.0)), done=self.ticks <= 0)
"""
RUNS = 4
STARTED_S = 300.0
ENDED_S = 180.0
STORE = "s3://wil/results"


@dataclass(frozen=True)
class Victim:
    """What is killed. text: in its command line. host: 0 for the campaign's, 1 for the other.

    engine: by which the campaign is resumed.
    """

    text: str
    host: int
    engine: str = "ray"


VICTIMS = {
    "program": Victim("wil_campaign run", 0),
    "worker": Victim("ray::NodeAgent", 1),
    "node process": Victim("wil_campaign.plugins.cluster.node_process", 1),
    "raylet": Victim("raylet/raylet", 1, "local"),
    "raylet here": Victim("raylet/raylet", 0, "local"),
    "head": Victim("gcs_server", 0, "local"),
    "store": Victim("moto.server", 0),
}


def survives(folder: Path, name: str, seed: int) -> bool:
    """Kill a victim in flight on two hosts, resume; print and return whether all is well."""
    folder.mkdir(parents=True)
    flights = folder / "flights.txt"
    flights.touch()
    campaign = _write_campaign(folder)
    os.environ["WIL_BENCH_FLIGHTS"] = str(flights)
    with two_hosts(folder) as hosts, cluster_of(*hosts) as address:
        by_store = bool(seed % 2) or name == "store"
        if by_store:
            start_store(hosts[0])
        trial = _Trial(hosts, campaign, str(folder), f"ray://{address}", by_store, flights)
        try:
            return trial.run(name, seed)
        except (TimeoutError, subprocess.TimeoutExpired) as error:
            print(f"{name}, seed {seed}: BAD: {error}; {trial.progress_text()}", flush=True)
            return False


@dataclass
class _Trial:
    hosts: tuple[Host, Host]
    campaign: Path
    out: str
    engine: str
    by_store: bool
    flights: Path

    def run(self, name: str, seed: int) -> bool:
        victim, (first, _) = VICTIMS[name], self.hosts
        program = first.start("run", *self._command(self.engine))
        wait_for(lambda: self._events()["ordered"] >= 2, STARTED_S, "the second order")
        time.sleep(random.Random(seed).uniform(0.0, 6.0))  # noqa: S311
        wait_for(lambda: self.hosts[victim.host].find(victim.text), 60, name)
        events = self._events()
        flying = events["ordered"] - events["ended"] - events["lost"] - events["found"]
        killed = self.hosts[victim.host].find(victim.text)
        if killed is not None:
            killed.kill()
        began_s = time.monotonic()
        code = program.wait(STARTED_S + ENDED_S)
        left = self._left()
        down_s = time.monotonic() - began_s
        before, finished = self._events(), self._finished()
        flown = self._begun()
        kept = self._count_left_on_nodes()
        if name == "store":
            start_store(first)
        engine = self.engine if victim.engine == "ray" else "local"
        resumed = first.run(*self._command(engine, "--resume"), timeout_s=STARTED_S + ENDED_S)
        verdicts = self._verdicts()
        faults = [
            *(["processes are left: " + "; ".join(left)] if left else []),
            *(f"{run} was flown twice" for run, count in flown.items() if count > 1),
            *(f"{run} was flown after its end" for run in self._flown_again()),
            *(f"{run} was finished and is lost" for run in finished if verdicts.get(run) != "PASS"),
            *([] if len(verdicts) == RUNS else [f"{len(verdicts)} results of {RUNS}"]),
            *([] if not self._left() else ["processes are left by the resumption"]),
        ]
        counts = dict(Counter(verdicts.values()))
        print(
            f"{name}, seed {seed}, {'store' if self.by_store else 'shared folder'}: killed with "
            f"{flying} runs in flight, after {down_s:.0f} s exit code {code} and nothing flies; "
            f"{dict(before)}; {kept} kept on nodes; "
            f"resumed ({engine.partition(':')[0]}): exit code {resumed.returncode}, {counts}, "
            f"{dict(self._events())}: {'fine' if not faults else 'BAD: ' + '; '.join(faults)}",
            flush=True,
        )
        if faults:
            print(resumed.stderr[-2000:], flush=True)
        return not faults

    def progress_text(self) -> str:
        """Return what a trial that has not come to its end has to say."""
        log = self.hosts[0].logs / "first-run.log"
        return f"{self._events()}; {log.read_text()[-2000:]}"

    def _command(self, engine: str, *more: str) -> list[str]:
        words = ["run", str(self.campaign), "--engine", engine, "--out", self.out, "--jobs", "2"]
        url = STORE if self.by_store else Path(self.out, "store").as_uri()
        store = [] if engine == "local" else ["--store", url]
        return self.hosts[0].program(*words, "--repetitions", str(RUNS), *store, *more)

    def _left(self) -> list[str]:
        """Return what still flies after a while; nothing when all has ended."""
        due_s = time.monotonic() + ENDED_S
        while True:
            flying = [one for host in self.hosts for one in host.flying()]
            if not flying or time.monotonic() > due_s:
                return [_line(one)[:120] for one in flying]
            time.sleep(0.5)

    def _text(self, pattern: str) -> str:
        """Return what files of the campaign have to say, as its host sees them."""
        script = f"cat {self.out}/hover/*/{pattern} 2>/dev/null"
        return self.hosts[0].run("sh", "-c", script).stdout

    def _ledger(self) -> list[dict[str, str]]:
        return [json.loads(line) for line in self._text("ledger.jsonl").splitlines()]

    def _events(self) -> Counter[str]:
        return Counter(line["event"] for line in self._ledger())

    def _finished(self) -> list[str]:
        """Return the runs of which the ledger has a verdict."""
        done = ("ended", "found")
        return [
            one["run"] for one in self._ledger() if one["event"] in done and one["text"] == "PASS"
        ]

    def _verdicts(self) -> dict[str, str]:
        runs = json.loads(self._text("summary.json"))["runs"]
        return {f"{one['case']}/{one['mode']}/{one['rep']}": one["verdict"] for one in runs}

    def _lines(self) -> list[list[str]]:
        return [line.split() for line in self.flights.read_text().splitlines()]

    def _begun(self) -> Counter[str]:
        return Counter(run for _, what, run, _ in self._lines() if what == "begin")

    def _flown_again(self) -> set[str]:
        """Return the runs that were begun after they had come to their end."""
        ended: set[str] = set()
        again: set[str] = set()
        for _, what, run, _ in self._lines():
            if what == "end":
                ended.add(run)
            elif run in ended:
                again.add(run)
        return again

    def _count_left_on_nodes(self) -> int:
        """Return how many results nodes have kept at the places that the campaign reported."""
        places = re.findall(r"kept in (\w+):(\S+?):", self._text("default/sim/*/result.json"))
        hosts = {host.name: host for host in self.hosts}
        there = [hosts[host].run("test", "-f", f"{path}/result.json") for host, path in places]
        return sum(one.returncode == 0 for one in there)


def _write_campaign(folder: Path) -> Path:
    (folder / "world.yaml").write_text(WORLD)
    (folder / "still.py").write_text(STILL)
    (folder / "hover.yaml").write_text(CAMPAIGN)
    return folder / "hover.yaml"


def _line(process: psutil.Process) -> str:
    try:
        return " ".join(process.cmdline())
    except psutil.Error:
        return ""
