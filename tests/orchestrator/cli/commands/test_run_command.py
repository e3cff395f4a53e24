"""`wil-campaign run` as a program: whoever looks on goes, the disk is full, signals come."""

import json
import multiprocessing
import os
import shlex
import signal
import subprocess
import sys
import threading
import time
import xml.etree.ElementTree as ET
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.hover import STILL, WORLD, write_hover
from wil_campaign.campaigns.expansion.expansion import load_campaign
from wil_campaign.orchestrator.campaign.folder import campaign_folder
from wil_campaign.orchestrator.campaign.folder.manifest import campaign_manifest
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.run_results.campaign_results import Summary, summarize

ROOT = Path(__file__).parents[4]
pytestmark = pytest.mark.usefixtures("forked_workers")


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """A campaign of two flights that take a second or two each."""
    return write_hover(tmp_path)


def command(campaign: Path, *options: str) -> list[str]:
    out = str(campaign.parent / "out")
    program = [sys.executable, "-m", "wil_campaign", "run", str(campaign)]
    return [*program, "--out", out, "--jobs", "1", *options]


def summary_of(campaign: Path) -> dict[str, Any]:
    (path,) = (campaign.parent / "out" / "hover").glob("*/summary.json")
    document: dict[str, Any] = json.loads(path.read_text())
    return document


def verdicts(campaign: Path) -> list[str]:
    return [run["verdict"] for run in summary_of(campaign)["runs"]]


@pytest.mark.parametrize("redirection", ["| head -n 1", ">&- 2>&- <&-"])
def test_a_campaign_flies_on_when_nobody_looks_on(campaign: Path, redirection: str) -> None:
    line = " ".join(command(campaign))
    done = subprocess.run(  # noqa: S603 - our own interpreter
        ["/bin/bash", "-c", f"set -o pipefail; {line} {redirection}"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert verdicts(campaign) == ["PASS", "PASS"]
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(("options", "code"), [((), 0), (("--json",), 3)])
def test_a_document_that_nobody_takes_is_no_success_and_progress_need_not_be_taken(
    campaign: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, ...],
    code: int,
) -> None:
    with Path("/dev/full").open("w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        assert main([*command(campaign)[3:], *options]) == code
    complaint = "standard output: No space left on device\n"
    assert capsys.readouterr().err == (complaint if code else "")
    assert verdicts(campaign) == ["PASS", "PASS"]


def wait_for_the_goal(campaign: Path) -> None:
    log = campaign.parent / "out" / "hover"
    deadline_s = time.monotonic() + 100.0
    while '"goal"' not in "".join(p.read_text() for p in log.glob("*/*/*/*/log.jsonl")):
        assert time.monotonic() < deadline_s
        time.sleep(0.05)


def assert_aborted(campaign: Path, by: str, said: str) -> None:
    (run,) = summary_of(campaign)["runs"]
    assert (run["verdict"], run["reason"]) == ("ABORTED", f"aborted by {by}")
    (landed,) = [oracle for oracle in run["oracles"] if oracle["name"] == "landed"]
    assert landed["verdict"] == "PASS"
    assert summary_of(campaign)["not_flown"] == ["default/sim/2"]
    assert "never flown: default/sim/2\n" in said
    assert "not accepted; never flown: 1 of 2" in said


ENDLESS = ("--set", "autonomy={use: still.py:Still, with: {ticks: 1000000}}")


def test_a_signal_to_the_whole_group_lands_flying_vehicles(campaign: Path) -> None:
    with subprocess.Popen(  # noqa: S603 - our own interpreter
        command(campaign, *ENDLESS),
        cwd=ROOT,
        start_new_session=True,
        stdout=subprocess.PIPE,
        text=True,
    ) as running:
        try:
            wait_for_the_goal(campaign)
            os.killpg(running.pid, signal.SIGINT)
            said, _ = running.communicate(timeout=100.0)
        finally:
            if running.poll() is None:
                os.killpg(running.pid, signal.SIGKILL)
    assert running.returncode == 130
    assert_aborted(campaign, "Ctrl-C", said)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_other_signals_land_flying_vehicles(
    campaign: Path, capsys: pytest.CaptureFixture[str], number: signal.Signals
) -> None:
    before = signal.signal(number, signal.SIG_DFL)  # what nohup has ignored stays ignored

    def send() -> None:
        wait_for_the_goal(campaign)
        for worker in multiprocessing.active_children():
            os.kill(worker.pid or 0, number)
        signal.pthread_kill(threading.main_thread().ident or 0, number)

    try:
        with ThreadPoolExecutor(1) as pool:
            sending = pool.submit(send)
            assert main([*command(campaign)[3:], *ENDLESS]) == 130
            sending.result()
    finally:
        signal.signal(number, before)
    assert_aborted(campaign, number.name, capsys.readouterr().out)


def test_a_signal_after_the_last_run_ends_the_program_as_ctrl_c_does(
    campaign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def summarize_with_signal(*args: Any, **options: Any) -> Summary:
        summary = summarize(*args, **options)
        if summary.accepted:  # the last one: those in flight accept nothing
            assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL  # which would end pytest
            os.kill(os.getpid(), signal.SIGTERM)
        return summary

    runner = "wil_campaign.orchestrator.campaign.campaign_runner"
    monkeypatch.setattr(f"{runner}.summarize", summarize_with_signal)
    assert main([*command(campaign)[3:], "--repetitions", "1"]) == 130
    document = summary_of(campaign)
    assert (document["accepted"], document["stopped"]) == (False, None)
    assert verdicts(campaign) == ["PASS"]
    monkeypatch.undo()
    assert main([*command(campaign)[3:], "--repetitions", "1", "--resume"]) == 0
    assert summary_of(campaign)["accepted"]


HANGS = """\
        import multiprocessing, pathlib, signal, time
        tried = multiprocessing.current_process().name == "autonomy check"
        hanging = multiprocessing.parent_process() is not None and not tried  # of the run
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM) if hanging else ():
            signal.signal(number, signal.SIG_IGN)
        while hanging:
            pathlib.Path(__file__).with_name("hangs").touch()
            time.sleep(1.0)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_that_hangs_before_its_first_word_ends_with_the_first_signal(
    campaign: Path, number: signal.Signals
) -> None:
    first = "        self.ticks = "
    assert first in STILL
    (campaign.parent / "still.py").write_text(STILL.replace(first, f"{HANGS}{first}"))
    with subprocess.Popen(  # noqa: S603 - our own interpreter
        command(campaign),
        cwd=ROOT,
        start_new_session=True,
        stdout=subprocess.PIPE,
        text=True,
    ) as running:
        try:
            deadline_s = time.monotonic() + 100.0
            while not (campaign.parent / "hangs").exists():
                assert time.monotonic() < deadline_s
                assert running.poll() is None
                time.sleep(0.05)
            os.kill(running.pid, number)
            said, _ = running.communicate(timeout=100.0)
        finally:
            if running.poll() is None:
                os.killpg(running.pid, signal.SIGKILL)
    assert running.returncode == 130
    document = summary_of(campaign)
    assert (document["stopped"], document["accepted"]) == ("signal", False)
    (run,) = document["runs"]
    assert run["verdict"] == "ERROR"
    assert "aborted before its process had prepared the run; it was killed" in run["reason"]
    assert "not accepted; never flown: 1 of 2; stopped by Ctrl-C or SIGTERM\n" in said


def test_a_document_says_that_nothing_has_passed_before_it_flies(
    campaign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    junit = campaign.parent / "ci" / "junit.xml"
    junit.parent.mkdir()
    seen: list[bytes] = []

    def stopped(flight: Coroutine[Any, Any, None]) -> None:
        flight.close()
        seen.append(junit.read_bytes())
        raise KeyboardInterrupt

    monkeypatch.setattr("wil_campaign.orchestrator.campaign.campaign_runner.asyncio.run", stopped)
    assert main([*command(campaign)[3:], "--junit", str(junit)]) == 130
    (case,) = ET.fromstring(seen[0]).iter("testcase")  # noqa: S314 - our own document
    assert case.find("error") is not None
    assert summary_of(campaign)["accepted"] is None


@pytest.mark.parametrize("spoilt", ["junit", "out", "no such folder", "out in a file"])
def test_an_output_that_cannot_be_written_is_reported_before_anything_flies(
    campaign: Path, capsys: pytest.CaptureFixture[str], spoilt: str
) -> None:
    given = {"out": str(campaign.parent / "out"), "junit": str(campaign.parent / "junit.xml")}
    name, bad = {
        "junit": ("junit", campaign.parent),
        "out": ("out", campaign),
        "no such folder": ("junit", campaign.parent / "nowhere" / "junit.xml"),
        "out in a file": ("out", campaign / "results"),
    }[spoilt]
    given[name] = str(bad)
    options = [word for name, value in given.items() for word in (f"--{name}", value)]
    assert main(["run", str(campaign), *options]) == 3
    said = capsys.readouterr()
    assert said.err.count("\n") == 1
    assert "written" in said.err
    assert given[name] in said.err
    # Not even what is going to be flown is told, and nothing is left behind.
    assert said.out == ""
    assert not (campaign.parent / "nowhere").exists()
    assert not list(campaign.parent.glob(".wil-*"))


@pytest.mark.parametrize(
    ("begin", "is_kept"),
    [("<?xml version='1.0' encoding='utf-8'?>\n<testsuites>", False), ("schema: mine", True)],
)
def test_a_refused_campaign_does_not_keep_the_junit_of_an_earlier_one(
    campaign: Path, begin: str, *, is_kept: bool
) -> None:
    junit = campaign.parent / "junit.xml"
    junit.write_text(begin)
    options = ["--set", "oracles.nothing={}", "--junit", str(junit)]
    assert main([*command(campaign)[3:], *options]) == 2
    assert junit.exists() is is_kept


def test_options_that_contradict_each_other_keep_no_junit_either(campaign: Path) -> None:
    junit = campaign.parent / "junit.xml"
    for options in (["--again", "default/sim/1"], ["--no-arm", "--resume"]):
        junit.write_text("<testsuites/>")
        assert main([*command(campaign)[3:], *options, "--junit", str(junit)]) == 2
        assert not junit.exists()


def test_a_campaign_flown_without_arming_is_not_resumed(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*command(campaign)[3:], "--no-arm"]) == 5
    (path,) = (campaign.parent / "out" / "hover").glob("*/campaign.json")
    assert json.loads(path.read_text())["arm"] is False
    capsys.readouterr()
    assert main([*command(campaign)[3:], "--resume"]) == 2
    assert "it was flown without arming (--no-arm)" in capsys.readouterr().err


def test_a_disk_that_fills_up_ends_the_campaign_with_a_sentence(
    campaign: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write: Any = vars(campaign_folder)["write_atomically"]
    documents: list[str] = []

    def until_full(path: Path, content: str | bytes) -> None:
        documents.append(path.name)
        if documents.count("summary.json") > 1:
            raise OSError(28, "No space left on device")
        write(path, content)

    monkeypatch.setattr(campaign_folder, "write_atomically", until_full)
    assert main(command(campaign)[3:]) == 3
    said = capsys.readouterr().err
    assert said.endswith("summary.json cannot be written: No space left on device\n")
    assert "Traceback" not in said
    assert verdicts(campaign) == []


def test_results_that_somebody_removes_while_others_fly_are_named(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = campaign.parent / "still.py"
    removing = (
        "import pathlib\nimport shutil\n\n"
        "for path in pathlib.Path(__file__).parent.glob('out/*/*/*/sim/1/result.json'):\n"
        "    shutil.rmtree(path.parent)\n"
    )
    code.write_text(code.read_text() + removing)
    assert main(command(campaign)[3:]) == 0
    assert "default/sim/1: result.json is missing\n" in capsys.readouterr().err


def test_runs_of_one_worker_do_not_know_of_each_other(campaign: Path) -> None:
    assert main(command(campaign)[3:]) == 0
    (folder,) = (campaign.parent / "out" / "hover").iterdir()
    notes = [
        path.read_text().splitlines()[-1].rpartition(",")[2]
        for path in sorted(folder.glob("*/*/*/trajectory.csv"))
    ]
    assert notes == ["1 by now", "1 by now"]


def test_what_is_next_has_the_options_that_chose_the_runs(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chosen = ["--repetitions", "1", "--set", "oracles.altitude.max_m=0.5"]
    assert main([*command(campaign)[3:], *chosen]) == 1
    (folder,) = (campaign.parent / "out" / "hover").iterdir()
    words = capsys.readouterr().out.partition("next: wil-campaign ")[2]
    again = shlex.split(words.partition(" tries other limits")[0])
    assert again == ["judge", str(campaign), str(folder), *chosen]
    assert main(again) == 1


def test_only_flown_runs_have_folders(campaign: Path) -> None:
    plans = load_campaign(campaign).runs
    assert main([*command(campaign)[3:], "--repetitions", "1"]) == 0
    (folder,) = (campaign.parent / "out" / "hover").iterdir()
    flown = [path.parent for path in folder.rglob("result.json")]
    assert [str(path.relative_to(folder)) for path in flown] == [plans[0].name]


def test_the_manifest_has_the_digest_of_every_file_that_is_named(campaign: Path) -> None:
    folder = campaign.parent
    (folder / "crate.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 1\nv 1 1 0\nf 1 2 3\nf 2 3 4\n")
    crate = "  crate: {shape: {mesh: {file: crate.obj}}, pose: {north_m: 5}}\n"
    (folder / "world.yaml").write_text(f"{WORLD}objects:\n{crate}")
    before = campaign_manifest(load_campaign(campaign), "virtual")["files"]
    assert isinstance(before, dict)
    assert set(before) == {"hover.yaml", "world.yaml", "still.py", "crate.obj"}
    (folder / "still.py").write_text(STILL + "\n")
    after = campaign_manifest(load_campaign(campaign), "virtual")["files"]
    assert isinstance(after, dict)
    assert {name for name in before if before[name] != after[name]} == {"still.py"}
