"""What is killed or interrupted on a bench in flight: its vehicle lands, and flies no second time.

A vehicle behind a socket really flies. The server of the bench is a program on a terminal of its
own, to which a node of a cluster without Ray is connected.
"""

import asyncio
import json
import os
import pty
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest

from tests.orchestrator.wall_runs import ROOT, stages
from tests.plugins.cluster.bench.test_bench_engine import PLACE, write_bench, write_campaign
from tests.plugins.cluster.bench.test_bench_flight import MortalBenchAgent, served, vehicle_at
from tests.plugins.cluster.fake_ray import FakeRay
from tests.ports import free_port
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.campaign.campaign_runner import (
    CampaignOutcome,
    fly_campaign,
)
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import (
    AttachedVehicle,
    find_vehicle_at,
)
from wil_campaign.orchestrator.campaign.resuming.runs_to_fly import (
    ResumeRules,
    resume_campaign,
)
from wil_campaign.orchestrator.campaign.resuming.runs_without_result import real_runs
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.orchestrator.operator.run_messages import RunProgressReport
from wil_campaign.orchestrator.run_results.result_reader import read_result
from wil_campaign.plugins.cluster.bench.bench_engine import HiredBench, hire_bench
from wil_campaign.plugins.cluster.bench.bench_messages import SOCKET_VARIABLE
from wil_campaign.plugins.cluster.node_messages import ConsentAnswer, ConsentAsked
from wil_campaign.plugins.cluster.store import open_store
from wil_campaign.vehicles.links.link_strings import parse_link

SERVE = """\
import subprocess, sys
from contextlib import contextmanager, suppress
from pathlib import Path
from wil_campaign.orchestrator.cli import main
from wil_campaign.plugins.cluster.bench import bench_command

@contextmanager
def node(address, facts, socket):
    with subprocess.Popen(["sleep", "1000"], start_new_session=True) as process:
        Path(sys.argv[2]).symlink_to(socket)
        try:
            yield process
        finally:
            process.kill()

bench_command.bench_node = node
sys.exit(main(["bench", "serve", sys.argv[1], "--engine", "ray://127.0.0.1:6379"]))
"""
INTERRUPT = b"\x03"


@dataclass
class ServedBench:
    """A bench that is served on a terminal. shown: what the person there has seen so far."""

    terminal: int
    process: psutil.Process
    shown: str = ""

    def read_until(self, text: str) -> None:
        while text not in self.shown:
            try:
                self.shown += os.read(self.terminal, 4096).decode()
            except OSError:  # so Linux ends a terminal
                raise AssertionError(self.shown) from None

    def type(self, text: bytes) -> None:
        os.write(self.terminal, text)

    def consent(self) -> None:
        self.read_until("take off? [y/N]")
        self.type(b"y\n")


@contextmanager
def bench_on_terminal(file: Path, socket: Path) -> Iterator[ServedBench]:
    """Serve a bench as a person does, on a terminal of its own."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.execve(  # noqa: S606 - our own interpreter
            sys.executable,
            [sys.executable, "-c", SERVE, str(file), str(socket)],
            {**os.environ, "PYTHONPATH": str(ROOT)},
        )
    process = psutil.Process(pid)
    try:
        yield ServedBench(terminal, process)
    finally:
        os.close(terminal)
        with suppress(psutil.NoSuchProcess):
            process.kill()
            process.wait()


class Once(SilentDisplay):
    """Does something once, when a run has come to its goal."""

    def __init__(self, act: Callable[[], object]) -> None:
        super().__init__()
        self._act: Callable[[], object] | None = act

    def progress(self, progress: RunProgressReport) -> None:
        if progress.stage == "goal" and self._act is not None:
            act, self._act = self._act, None
            act()


@pytest.fixture(autouse=True)
def socket_of_bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv(SOCKET_VARIABLE, str(tmp_path / "server"))
    return tmp_path / "server"


@pytest.fixture
def node_folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where the bench's machine has its temporary files, and so the runs that it flies."""
    with tempfile.TemporaryDirectory(prefix="wil-node-") as folder:
        monkeypatch.setenv("TMPDIR", folder)
        monkeypatch.setattr(tempfile, "tempdir", None)
        yield Path(folder)


def fly(path: Path, hired: HiredBench, act: Callable[[], object]) -> CampaignOutcome:
    campaign = load_campaign(path, ExpansionOptions(benches=(hired.bench,)))
    options = FlightOptions(out=path.parent / "out")
    cleared = ClearedCampaign(
        "wall",
        1,
        real_kind="sitl",
        engine=hired.engine(open_store((path.parent / "store").as_uri())),
    )
    return fly_campaign(campaign, options, cleared, Once(act))


def ledger(folder: Path) -> list[str]:
    text = (folder / "ledger.jsonl").read_text()
    return [json.loads(line)["event"] for line in text.splitlines()]


def vehicle_on(port: int) -> AttachedVehicle:
    return asyncio.run(find_vehicle_at(parse_link(f"udpin://127.0.0.1:{port}"), 20.0))


class Killing:
    """Kills the process of the run in flight. guard: that of its vehicle, which lives on."""

    def __init__(self, folder: Path) -> None:
        self.guard: list[psutil.Process] = []
        self._folder = folder

    def __call__(self) -> None:
        (run,) = [one for one in psutil.process_iter() if _is_run(one, self._folder)]
        self.guard = [one for one in psutil.process_iter() if _is_guard(one, run)]
        run.kill()


def _is_run(one: psutil.Process, folder: Path) -> bool:
    """Return whether a process flies a run beneath a folder."""
    with suppress(psutil.Error):
        if "forkserver" in " ".join(one.cmdline()):
            return any(folder in Path(file.path).parents for file in one.open_files())
    return False


def _is_guard(one: psutil.Process, run: psutil.Process) -> bool:
    """Return whether a process is the guard that writes its log beside that of a run."""
    with suppress(psutil.Error):
        if "wil_campaign.safety.guard.process" in one.cmdline():
            folders = {Path(file.path).parent for file in run.open_files()}
            return any(Path(file.path).parent in folders for file in one.open_files())
    return False


def test_the_guard_lands_the_vehicle_of_a_killed_process_and_it_flies_no_more(
    tmp_path: Path, node_folder: Path
) -> None:
    port = free_port()
    path, bench = write_campaign(tmp_path, ticks=4000), write_bench(tmp_path, port)
    agree = ConsentAnswer(code=0, real_kind="sitl")
    killing = Killing(node_folder)
    with served(bench, tmp_path, lambda _: agree), vehicle_at(port):
        hired = hire_bench(FakeRay(MortalBenchAgent), "hall-a", 60.0)
        assert hired.ask_consent(ConsentAsked("hover", 2, arm=True, place=PLACE)).problem == ""
        with pytest.raises(EngineError, match="default/real/1 was lost with a real vehicle"):
            fly(path, hired, killing)
        (folder,) = (tmp_path / "out" / "hover").iterdir()
        lost = read_result(folder / "default/real/1/result.json")
        assert (lost.verdict, len(killing.guard)) == ("ERROR", 1)
        assert "ended by SIGKILL" in lost.reason
        assert ledger(folder) == ["begun", "ordered", "lost"]
        # The guard is still at it: nothing else flew there meanwhile.
        assert psutil.wait_procs(killing.guard, timeout=60.0)[1] == []
        assert not vehicle_on(port).armed
    assert "the orchestrator ended" in (folder / "default/real/1/guard.jsonl").read_text()
    campaign = load_campaign(path, ExpansionOptions(benches=(bench,)))
    kept = resume_campaign(
        campaign, folder, ResumeRules(is_real=real_runs(campaign, "")), say=lambda _: None
    )
    assert dict(kept.results) == {"default/real/1": lost}
    assert dict(kept.attempts) == {"default/real/2": ()}


def test_ctrl_c_at_the_bench_lands_the_run_and_ends_the_server(
    tmp_path: Path, socket_of_bench: Path
) -> None:
    port = free_port()
    path, file = write_campaign(tmp_path, ticks=4000), write_bench(tmp_path, port).document.path
    path.write_text(path.read_text().replace("repetitions: 2", "repetitions: 1"))
    with bench_on_terminal(file, socket_of_bench) as bench, vehicle_at(port):
        bench.read_until("Ctrl-C ends it")
        hired = hire_bench(FakeRay(MortalBenchAgent), "hall-a", 60.0)
        person = threading.Thread(target=bench.consent)
        person.start()
        assert hired.ask_consent(ConsentAsked("hover", 1, arm=True, place=PLACE)).problem == ""
        person.join()
        flown = fly(path, hired, lambda: bench.type(INTERRUPT))
        assert bench.process.wait(60.0) == 0
        (lost,) = flown.summary.runs
        assert flown.summary.not_flown == ()
        assert (lost.verdict, flown.exit_code) == ("ABORTED", 4), (lost.reason, bench.shown)
        assert lost.reason == "aborted by Ctrl-C at the terminal of bench hall-a"
        assert ledger(flown.folder) == ["begun", "ordered", "ended"]
        assert stages(flown.folder / "default/real/1")[-2:] == ["landed", "end"]
        assert not vehicle_on(port).armed
