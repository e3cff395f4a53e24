"""Code of the user's that changes is seen, however it was found: between runs, at a resumption."""

import importlib.util
import json
import os
import sys
from importlib.machinery import ModuleSpec
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from tests.orchestrator.hover import STILL, write_hover
from wil_campaign.campaigns.checks import autonomy_checks
from wil_campaign.campaigns.setup.autonomy_under_test import UnderTest
from wil_campaign.foundation.files.user_modules import forget_user_modules
from wil_campaign.orchestrator.campaign.workers import run_engine
from wil_campaign.orchestrator.campaign.workers.run_order import fly_order
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.operator.run_messages import OperatorInbox, Report
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder

FIVE_WAYS = """\
import importlib.util
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "by_path"))
import found_by_path_of_ours
import found_by_environment_of_ours
from .beside import found_beside_of_ours
import found_by_editable_of_ours

_SPEC = importlib.util.spec_from_file_location(
    "any", Path(__file__).parent / "by_spec" / "found_by_spec_of_ours.py"
)
_SPEC.loader.exec_module(importlib.util.module_from_spec(_SPEC))
"""
FILES = (
    "by_path/found_by_path_of_ours.py",
    "by_environment/found_by_environment_of_ours.py",
    "beside/found_beside_of_ours.py",
    "by_editable/found_by_editable_of_ours.py",
    "by_spec/found_by_spec_of_ours.py",
    "in_flight_of_ours.py",
)
"""Modules that the autonomy finds in as many ways; the last one is imported in flight alone."""

REPORT = vars(autonomy_checks)["_report"]

pytestmark = pytest.mark.usefixtures("forked_workers")


class Finder:
    """What an editable installation puts beside the path, in each process."""

    def __init__(self, campaigns: Path) -> None:
        self.place = campaigns / "by_editable"

    def find_spec(self, name: str, _: object = None, __: object = None) -> ModuleSpec | None:
        if name != "found_by_editable_of_ours":
            return None
        return importlib.util.spec_from_file_location(name, self.place / f"{name}.py")


def report_beside_finder(connection: Connection, under_test: UnderTest) -> None:
    assert under_test.code_folder is not None
    sys.meta_path.append(Finder(under_test.code_folder))
    REPORT(connection, under_test)


def fly_beside_finder(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    sys.meta_path.append(Finder(order.plan.files.campaign.path.parent))
    return fly_order(order, report, inbox)


@pytest.fixture
def campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a campaign whose autonomy imports modules in each way that Python has."""
    for name in FILES:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("GAIN = 1\n")
    path = write_hover(tmp_path)
    late = "        import in_flight_of_ours\n\n        COUNT.append(in_flight_of_ours.GAIN)\n"
    flown = STILL.replace("        COUNT.append(1)\n", late)
    (tmp_path / "still.py").write_text(FIVE_WAYS + flown)
    monkeypatch.setattr(run_engine, "fly_order", fly_beside_finder)
    monkeypatch.setattr(autonomy_checks, "_report", report_beside_finder)
    monkeypatch.syspath_prepend(str(tmp_path / "by_environment"))
    return path


def run(campaign: Path, *options: str) -> int:
    out = str(campaign.parent / "out")
    for name in [name for name in sys.modules if name.endswith("_of_ours")]:
        del sys.modules[name]
    forget_user_modules()
    return main(["run", str(campaign), "--out", out, "--jobs", "1", *options])


def test_a_change_of_any_module_is_seen_before_a_resumption(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(campaign) == 0
    (folder,) = (campaign.parent / "out" / "hover").iterdir()
    result = json.loads((folder / "default" / "sim" / "1" / "result.json").read_text())
    assert set(result["code"]) == {"still.py", *FILES}
    manifest = json.loads((folder / "campaign.json").read_text())
    assert {"still.py", *FILES} <= set(manifest["files"])
    assert run(campaign, "--resume") == 0
    for name in FILES:
        path = campaign.parent / name
        before = path.stat()
        path.write_text("GAIN = 2\n")
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
        capsys.readouterr()
        assert run(campaign, "--resume") == 2, name
        said = capsys.readouterr().err
        assert f"{name} changed" in said
        assert "cannot be resumed" in said
        path.write_text("GAIN = 1\n")
    assert run(campaign, "--resume") == 0
