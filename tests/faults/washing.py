"""Campaigns with `retries` whose first attempt must fail, and whose second would pass."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import yaml

from tests.faults.alterations import Alteration
from tests.faults.missions import LEGS
from tests.faults.signals import Outcome, SignalFault, Strike, mission_file
from tests.orchestrator.conftest import vehicles_on, workers_forked
from wil_campaign.campaigns.expansion.expansion import Campaign, load_campaign
from wil_campaign.orchestrator.campaign.campaign_runner import fly_campaign
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.workers.local_workers import LocalWorkers
from wil_campaign.orchestrator.campaign.workers.run_order import completed_run, fly_order
from wil_campaign.orchestrator.campaign.workers.run_server import start_run_server
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.orchestrator.operator.run_messages import OperatorInbox, Report
from wil_campaign.orchestrator.run.flight import run as running
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder

SIGNAL = "a signal"
BY_AUTONOMY: Mapping[str, str] = {
    "exits": "os._exit(3)",
    "crashes": "os.kill(os.getpid(), signal.SIGSEGV)",
    "too much memory": "self.kept.append(b'x' * 400_000_000)",
    "refused memory": "self.kept.append(b'x' * 4_000_000_000)",
    "hangs": "time.sleep(3)",
    "raises": "raise RuntimeError('lost')",
    "a thread exits": (
        "self.left = [(0, 0, 0)] * 10**6; threading.Timer(0.05, os._exit, (4,)).start()"
    ),
}
"""What an autonomy does in the air of its first attempt."""
WASHED = (SIGNAL, SIGNAL, SIGNAL, *BY_AUTONOMY)
"""Why a first attempt fails: a fault of a signal where the mission fails, or the autonomy."""

_TWICE = """

class Twice(Legs):
    '''Flies its legs in its first flight, in which it does WHAT, and hovers in each other.'''

    def __init__(self, *, goal, parameters, seed):
        super().__init__(goal=goal, parameters=parameters, seed=seed)
        self.kept, self.is_first, self.count = [], True, 0

    def act(self, telemetry):
        flown = Path(__file__).with_name("flown")
        if self.count == 0:
            self.is_first = not flown.exists()
            flown.touch()
            if not self.is_first:
                self.left = [(0.0, 0.0, 0.0)] * 20
        self.count += 1
        if self.is_first and self.count == 20:
            WHAT
        return super().act(telemetry)
"""
_IMPORTS = "import os\nimport signal\nimport threading\nimport time\nfrom pathlib import Path\n\n"


@dataclass(frozen=True, slots=True)
class _Engine:
    """Flies the runs in processes of this machine, the first attempts with a fault."""

    reads_files_here: bool = True

    def workers(
        self,
        campaign: Campaign,
        folder: Path,
        say: Callable[[str], None],
    ) -> LocalWorkers[RunOrder, RunResult]:
        """Return worker processes."""
        return LocalWorkers(fly_washed, completed_run)


def fly_washed(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    """Fly an order; its first attempt with the fault in its campaign's folder."""
    written = order.plan.files.campaign.path.parent / "fault.json"
    fly = running.fly_one_run
    if not order.attempts and written.exists():
        given = json.loads(written.read_text())
        alteration = Alteration(**given["alteration"])
        strike = Strike(SignalFault(**{**given, "alteration": alteration}))
        running.fly_one_run = partial(fly, disturb=strike.disturb)
    try:
        with vehicles_on():
            return fly_order(order, report, inbox)
    finally:
        running.fly_one_run = fly


def inject(fault: SignalFault, washed: SignalFault, folder: Path) -> Outcome:
    """Fly a campaign whose first attempt must fail; its campaign must not be accepted.

    washed: the fault of a signal in its first attempt, where that is what fails it.
    """
    folder.mkdir(parents=True)
    kind = fault.kind
    path = mission_file(washed, folder)
    campaign = yaml.safe_load(path.read_text())
    limits = {"memory_mb": 300, "call_s": 0.5 if kind == "hangs" else 30}
    campaign["autonomy"] = {**campaign["autonomy"], "use": "legs.py:Twice", "limits": limits}
    campaign |= {"repetitions": 1, "retries": 1}
    path.write_text(yaml.safe_dump(campaign, sort_keys=False))
    what = BY_AUTONOMY.get(kind, "pass")
    (folder / "legs.py").write_text(_IMPORTS + LEGS + _TWICE.replace("WHAT", what))
    if kind == SIGNAL:
        (folder / "fault.json").write_text(json.dumps(asdict(washed)))
    start_run_server()
    with workers_forked():
        options = FlightOptions(out=folder / "out")
        cleared = ClearedCampaign("virtual", 1, engine=_Engine())
        flown = fly_campaign(load_campaign(path), options, cleared, SilentDisplay())
    (run,) = flown.summary.runs
    accepted = run.verdict == "PASS" or flown.exit_code == 0
    exempt = accepted and bool(run.attempts) and not _failed(flown.folder)
    verdict = "PASS" if accepted else run.verdict
    decided_by = run.decided_by or ""
    return Outcome(fault, verdict, run.reason, decided_by, exempt, accepted and not exempt)


def _failed(folder: Path) -> bool:
    """Return whether the first attempt of a campaign's only run has a FAIL anywhere in it."""
    (attempt,) = (folder / "earlier/default/sim").glob("1-1")
    log = (attempt / "log.jsonl").read_text().splitlines()
    decided = [one for one in map(json.loads, log) if one.get("event") == "decisive"]
    return any(one["kind"] == "FAIL" for one in decided)
