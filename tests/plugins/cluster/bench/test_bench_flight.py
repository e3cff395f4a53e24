"""A bench of a cluster without Ray, with a vehicle behind a socket that really flies."""

import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Listener
from pathlib import Path

import pytest

from tests.orchestrator.campaign.test_attached_run import await_datagram
from tests.orchestrator.wall_runs import ROOT, stages
from tests.plugins.cluster.bench.test_bench_engine import PLACE, write_bench, write_campaign
from tests.plugins.cluster.fake_ray import FakeRay
from tests.ports import free_port
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.campaigns.setup.bench_file import Bench
from wil_campaign.orchestrator.campaign.campaign_runner import fly_campaign
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.orchestrator.operator.run_messages import RunProgressReport
from wil_campaign.plugins.cluster.bench.bench_engine import BenchAgent, hire_bench
from wil_campaign.plugins.cluster.bench.bench_messages import SOCKET_VARIABLE
from wil_campaign.plugins.cluster.bench.bench_server import BenchServer
from wil_campaign.plugins.cluster.node_messages import ConsentAnswer, ConsentAsked
from wil_campaign.plugins.cluster.store import open_store
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings

IN_FLIGHT = {"takeoff", "at_height", "goal"}


class MortalBenchAgent(BenchAgent):
    """An agent whose death ends its connection, as Ray has it."""

    def die(self) -> None:
        # One that has closed its connection has nothing left to lose.
        with suppress(OSError), socket.socket(fileno=os.dup(self._to.fileno())) as one:
            one.shutdown(socket.SHUT_RDWR)


@contextmanager
def served(
    bench: Bench, folder: Path, consent: Callable[[ConsentAsked], ConsentAnswer]
) -> Iterator[list[str]]:
    """Serve a bench in a thread of this process; yields what its person is shown."""
    shown: list[str] = []
    place = str(folder / "server")
    server = BenchServer(bench, consent=consent, say=shown.append)
    with Listener(place, family="AF_UNIX") as listener:
        thread = threading.Thread(target=server.serve, args=(listener,))
        thread.start()
        try:
            yield shown
        finally:
            server.stop(place)
            thread.join()


class DyingSecond(SilentDisplay):
    """Kills something when the second run has left for its height."""

    def __init__(self, kill: Callable[[], object]) -> None:
        super().__init__()
        self._kill: Callable[[], object] | None = kill

    def progress(self, progress: RunProgressReport) -> None:
        if progress.repetition == 2 and progress.stage in IN_FLIGHT and self._kill is not None:
            kill, self._kill = self._kill, None
            kill()


@contextmanager
def vehicle_at(port: int) -> Iterator[None]:
    """Have an embedded vehicle, which runs, be the hardware of a bench, behind a socket."""
    link = f"udpout://127.0.0.1:{port}"
    settings = ProcessSettings(autopilot="px4", link=link, seed=1, running_s=60.0)
    process = subprocess.Popen(  # noqa: S603  # our own interpreter
        [sys.executable, "-m", "wil_campaign.vehicles.embedded", settings.model_dump_json()],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        start_new_session=True,
    )
    try:
        await_datagram(port)
        yield
    finally:
        process.terminate()
        process.wait()


def test_a_bench_flies_after_consent_and_never_repeats_a_run_that_died_in_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv(SOCKET_VARIABLE, str(tmp_path / "server"))
    port = free_port()
    path, bench = write_campaign(tmp_path), write_bench(tmp_path, port)
    ray, asked = FakeRay(MortalBenchAgent), list[ConsentAsked]()

    def agree(one: ConsentAsked) -> ConsentAnswer:
        asked.append(one)
        return ConsentAnswer(code=0, real_kind="sitl")

    with served(bench, tmp_path, agree) as shown, vehicle_at(port):
        hired = hire_bench(ray, "hall-a", 60.0)
        assert ray.options["resources"] == {"bench:hall-a": 1}
        assert ray.options["max_restarts"] == ray.options["max_task_retries"] == 0
        assert hired.bench.facts == bench.facts  # of the file that came from the bench
        wanted = ConsentAsked("hover", 2, arm=True, place=PLACE)
        assert hired.ask_consent(wanted).problem == ""
        campaign = load_campaign(path, ExpansionOptions(benches=(hired.bench,)))
        options = FlightOptions(out=tmp_path / "out")
        cleared = ClearedCampaign(
            "wall",
            1,
            real_kind="sitl",
            engine=hired.engine(open_store((tmp_path / "store").as_uri())),
        )
        flown = fly_campaign(campaign, options, cleared, DyingSecond(ray.actors[0].die))
    passed, lost = flown.summary.runs
    assert (passed.verdict, passed.reason, asked) == ("PASS", "", [wanted])
    assert (lost.verdict, flown.exit_code) == ("ERROR", 3)
    assert "has lost the worker" in lost.reason
    ledger = (flown.folder / "ledger.jsonl").read_text().splitlines()
    events = [json.loads(line)["event"] for line in ledger]
    assert events == ["begun", "ordered", "ended", "ordered", "lost"]
    assert stages(flown.folder / "default" / "real" / "2")[-2:] == ["landed", "end"]
    assert shown == ["bench hall-a is free"]
