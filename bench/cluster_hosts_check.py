"""Flies over two hosts by the commands of docs/cluster.md, and prints what each trial came to."""

import contextlib
import json
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from bench.cluster_bench import HALL
from bench.cluster_files import contents, write_campaign
from bench.cluster_hosts import (
    STARTED_S,
    Host,
    start_head,
    start_node,
    start_store,
    two_hosts,
    wait_for,
)

STORE = "s3://wil/results"
ROOT = Path(__file__).resolve().parent.parent
_TWICE = '--resources={"bench:hall-b": 1}'
"""Both hosts say that they have this bench."""
FLEE = "import sys; raise ImportError('no such module here')\n"
LATE = """\
import os, sys
node = "wil_campaign.plugins.cluster.node_process"
if node in sys.orig_argv and "LD_PRELOAD" not in os.environ:
    preload = "/usr/lib/x86_64-linux-gnu/faketime/libfaketime.so.1"
    late = {"LD_PRELOAD": preload, "FAKETIME": "+3600s", "FAKETIME_DONT_FAKE_MONOTONIC": "1"}
    os.execve(sys.executable, sys.orig_argv, {**os.environ, **late})
"""
JOIN = """\
import sys, ray
try:
    ray.init(address=sys.argv[1], log_to_driver=False, logging_level="ERROR")
except BaseException as error:
    sys.exit(f"refused: {str(error).strip().splitlines()[0]}")
print(ray.cluster_resources())
"""


@dataclass
class _Check:
    """The trials on two hosts of one cluster. folder: that both have."""

    folder: Path
    first: Host
    second: Host
    bad: int = 0
    engine: str = field(init=False)

    def __post_init__(self) -> None:
        self.engine = f"ray://{self.first.address}:6379"

    def say(self, what: str, fine: bool, seen: str) -> None:
        """Print what a trial came to."""
        self.bad += not fine
        print(f"{'fine' if fine else 'BAD '} {what}: {' '.join(seen.split())}", flush=True)

    def fly(self, campaign: Path, out: str, *more: str) -> tuple[int, str]:
        """Fly a campaign from the first host; return its exit code and what it says."""
        words = ("run", str(campaign), "--out", out, "--repetitions", "4", *more)
        ended = self.first.run(*self.first.program(*words))
        return ended.returncode, ended.stderr

    def over_nodes(self, what: str, out: str, *more: str) -> None:
        """Fly over both nodes, and compare with the flights of one machine."""
        campaign = write_campaign(self.folder / "campaign", ticks=1)
        here = self.folder / "local"
        if not here.exists():
            self.fly(campaign, str(here))
        code, output = self.fly(campaign, out, "--engine", self.engine, *more)
        copy = self.folder / "copy"
        shutil.rmtree(copy, ignore_errors=True)
        self.first.run("cp", "-r", out, str(copy))
        (flown,), (local,) = copy.glob("hover/*"), here.glob("hover/*")
        lines = [json.loads(line) for line in (flown / "ledger.jsonl").read_text().splitlines()]
        nodes = sorted({line["node"] for line in lines if line["event"] == "ended"})
        same = contents(flown) == contents(local)
        fine = code == 0 and nodes == ["first", "second"] and same
        seen = f"exit code {code}, ended on {nodes}, results {'' if same else 'NOT '}equal to local"
        self.say(what, fine, seen if fine else f"{seen}; {output}")

    def refused(self, what: str, wanted: str, *more: str) -> None:
        """Fly what must be refused with exit code 2 and a remedy."""
        campaign = write_campaign(self.folder / "campaign", ticks=1)
        self.refused_file(what, wanted, campaign, *more)

    def refused_file(self, what: str, wanted: str, campaign: Path, *more: str) -> None:
        """Fly a campaign that must be refused with exit code 2, a place or a remedy."""
        code, output = self.fly(campaign, "/tmp/refused", "--engine", self.engine, *more)  # noqa: S108
        self.say(what, code == 2 and wanted in output, f"exit code {code}: {output}")

    @contextmanager
    def second_node(self, **environment: str) -> Iterator[None]:
        """Have the second host join the cluster, with an environment, until the end."""
        before = self.second.environment
        self.second.environment = {**before, **environment}
        node = start_node(self.second, f"{self.first.address}:6379", 2, _TWICE)
        self.second.environment = before
        try:
            yield
        finally:
            node.send_signal(signal.SIGTERM)
            with contextlib.suppress(Exception):
                node.wait(30)
            self.second.end()
            time.sleep(1.0)


def compare_hosts(folder: Path) -> int:
    """Make all trials; return the exit code."""
    with two_hosts(folder) as (first, second):
        check = _Check(folder, first, second)
        start_head(first, 2, _TWICE)
        start_store(first)
        shared = (folder / "store").as_uri()
        _token(check)
        with check.second_node():
            check.over_nodes("shared folder", "/tmp/shared", "--store", shared)  # noqa: S108
            check.refused(
                "a folder that the other host does not see", "--store", "--store", "file:///tmp/own"
            )
            check.over_nodes("store", "/tmp/stored", "--store", STORE)  # noqa: S108
            _benches(check)
            _operators(check)
        _unfit(check)
        return 1 if check.bad else 0


def compare_clocks(folder: Path) -> int:
    """Fly over two hosts whose clocks are an hour apart; return the exit code.

    The second's is that of what flies there. Ray's own processes do not start under libfaketime.
    """
    (folder / "late").mkdir()
    (folder / "late/sitecustomize.py").write_text(LATE)
    with two_hosts(folder) as (first, second):
        check = _Check(folder, first, second)
        start_head(first, 2, _TWICE)
        start_store(first)
        shared = (folder / "store").as_uri()
        with check.second_node(PYTHONPATH=f"{folder}/late:{ROOT}"):
            out = str(folder / "shared")
            check.over_nodes("a clock an hour ahead, shared folder", out, "--store", shared)
            check.over_nodes("a clock an hour ahead, store", "/tmp/late", "--store", STORE)  # noqa: S108
            _operators(check)
        texts = (path.read_text() for path in (folder / "shared").glob("hover/*/**/output.txt"))
        clocks_s = sorted(round(float(text.split()[0]) - time.time()) for text in texts)
        print(f"     clocks of the runs, from now: {clocks_s} s", flush=True)
        return 1 if check.bad else 0


def _token(check: _Check) -> None:
    """Have processes join that have another token, or none."""
    address = f"{check.first.address}:6379"
    for what, more in (
        ("a process without the token", {"RAY_AUTH_MODE": "disabled", "RAY_AUTH_TOKEN": ""}),
        ("a process with another token", {"RAY_AUTH_TOKEN": "another-token-0123456789abcdef0123"}),
    ):
        ended = check.second.run(sys.executable, "-c", JOIN, address, **more)
        check.say(
            what, ended.returncode != 0, f"exit code {ended.returncode}: {ended.stderr[-300:]}"
        )
    campaign = write_campaign(check.folder / "campaign", ticks=1)
    words = check.first.program("run", str(campaign), "--engine", check.engine)
    ended = check.first.run(*words, RAY_AUTH_MODE="", RAY_AUTH_TOKEN="")
    check.say(
        "our own program without the token",
        ended.returncode == 2 and "needs a token" in ended.stderr,
        f"exit code {ended.returncode}: {ended.stderr}",
    )


def _benches(check: _Check) -> None:
    """Ask for benches that the cluster does not have, or has twice."""
    text = HALL.replace("recipe: recipe.yaml\n", "").replace("[wil]", "[sim]")
    for what, asked, wanted in (
        ("a bench that there is not", "{name: nowhere, wait_s: 2}", "there is no bench 'nowhere'"),
        ("a property that no bench has", "{properties: {roof: true}, wait_s: 2}", "'roof'"),
        ("two benches of one name", "{name: hall-b, wait_s: 2}", "two benches named"),
    ):
        campaign = write_campaign(check.folder / "benches", ticks=1).with_name("hall.yaml")
        campaign.write_text(text.replace("bench: hall-a", f"bench: {asked}"))
        check.refused_file(what, wanted, campaign)


def _unfit(check: _Check) -> None:
    """Have the second host be a node that cannot fly the same."""
    other = check.folder / "other"
    without = shutil.ignore_patterns(".git", ".venv", "docs", "tests")
    shutil.copytree(ROOT, other / "code", symlinks=True, ignore=without)
    with (other / "code/worlds/__init__.py").open("a") as stream:
        stream.write("# another version\n")
    for name, text in (("fsspec", FLEE), ("wil_campaign", FLEE)):
        (other / f"no-{name}" / name).mkdir(parents=True)
        (other / f"no-{name}" / name / "__init__.py").write_text(text)
    with check.second_node(PYTHONPATH=str(other / "code")):
        check.refused("a node with another code", "install the same wheel", "--store", STORE)
    with check.second_node(PYTHONPATH=f"{other}/no-fsspec:{ROOT}"):
        check.refused("a node without fsspec", "[cluster,storage]", "--store", STORE)
    with check.second_node(PYTHONPATH=f"{other}/no-wil_campaign:{ROOT}"):
        check.refused("a node without wil-campaign", "install the same wheel", "--store", STORE)


def _operators(check: _Check) -> None:
    """Command runs on both nodes from the first host, and what flies on the second from there."""
    campaign = write_campaign(check.folder / "endless", ticks=200_000)
    words = ("run", str(campaign), "--engine", check.engine, "--clock", "wall", "--jobs", "2")
    out = check.folder / "operated"
    command = check.first.program(*words, "--out", str(out), "--repetitions", "3")
    for name, act in (("one node", _abort_node), ("a run that hangs", _abort_hung)):
        program = check.first.start("operated", *command)
        try:
            wait_for(lambda: _goals(check.first) == 2, STARTED_S, "two runs at their goal")
            act(check, name)
            code = program.wait(180)
            flown = max(out.glob("hover/*"))
            runs = json.loads((flown / "summary.json").read_text())["runs"]
            verdicts = [(run["rep"], run["verdict"], run["reason"]) for run in runs]
            fine = code == 4 and not {verdict[1] for verdict in verdicts} & {"PASS", "FAIL"}
            check.say(f"{name}: the end of the campaign", fine, f"exit code {code}, {verdicts}")
        finally:
            with contextlib.suppress(ProcessLookupError):
                program.kill()
                program.wait()


def _abort_node(check: _Check, _: str) -> None:
    first, second = check.first, check.second
    watched = _status(first)
    places = {run: one["place"] for run, one in watched["flying"].items()}
    check.say("watch", sorted(places.values()) == ["first", "second"], f"{places}")
    for what in (
        ("hold",),
        ("resume",),
        ("abort", "--node", "third"),
        ("abort", "--node", "second"),
    ):
        ended = first.run(*first.program(*what, "--who", "anna"))
        wanted = 3 if "third" in what else 0
        output = f"exit code {ended.returncode}: {ended.stdout} {ended.stderr}"
        both = what[0] == "abort" or ("on first" in ended.stdout and "on second" in ended.stdout)
        check.say(" ".join(what), ended.returncode == wanted and both, output)
    wait_for(lambda: _is_left(first, ["first"]), 60, "the landing of one")
    check.say("after that", fine=True, seen=str(_status(first)["finished"]))
    began_s = time.monotonic()
    there = first.run(*first.program("abort", "--who", "anna"))
    check.say("abort of all", there.returncode == 0, f"{there.stdout} {there.stderr}")
    wait_for(lambda: not first.flying_runs() and not second.flying_runs(), 60, "all down")
    print(f"     down after {time.monotonic() - began_s:.0f} s", flush=True)


def _abort_hung(check: _Check, _: str) -> None:
    first, second = check.first, check.second
    runs = second.flying_runs()
    for run in runs:
        run.suspend()
    began_s = time.monotonic()
    ended = first.run(*first.program("abort", "--who", "anna"))
    output = f"exit code {ended.returncode}: {ended.stdout} {ended.stderr}"
    check.say("abort with a run that hangs on second", ended.returncode == 3, output)
    wait_for(lambda: _latched(check), 30, "the guard")
    print(f"     its guard had it after {time.monotonic() - began_s:.1f} s: {_latched(check)}")
    for run in runs:
        with contextlib.suppress(Exception):
            run.resume()


def _latched(check: _Check) -> str:
    """Return what the guards of the newest campaign say of an operator."""
    flown = max((check.folder / "operated").glob("hover/*"))
    texts = [path.read_text() for path in flown.glob("default/sim/*/guard.jsonl")]
    lines = [line for text in texts for line in text.splitlines() if "anna" in line]
    return lines[0][:200] if len(lines) > 1 else ""


def _status(host: Host) -> dict[str, dict[str, dict[str, str]]]:
    """Return the status of the campaign that flies from a host."""
    script = (
        "import json\n"
        "from wil_campaign.orchestrator.operator.campaign_records import operator_places\n"
        "from wil_campaign.orchestrator.operator.socket_client import ask_operator_socket\n"
        "found = operator_places().campaigns\n"
        "first = found[0].socket if found else None\n"
        "print(json.dumps(ask_operator_socket(first, 'status', who='bench') if first else {}))\n"
    )
    ended = host.run(sys.executable, "-c", script)
    answer: dict[str, dict[str, dict[str, str]]] = json.loads(ended.stdout or "{}")
    return answer


def _goals(host: Host) -> int:
    flying = _status(host).get("flying", {})
    return sum(one["stage"] == "goal" for one in flying.values())


def _is_left(host: Host, places: list[str]) -> bool:
    return sorted(one["place"] for one in _status(host).get("flying", {}).values()) == places
