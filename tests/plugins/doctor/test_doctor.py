"""wil-campaign doctor: what a machine has and lacks, and what to do about it."""

import json
import os
import pwd
import socket
import subprocess
import sys
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from tests.orchestrator.wall import write_wall
from tests.ports import free_port
from wil_campaign.foundation.processes.identity import ProcessId
from wil_campaign.orchestrator.cli import main
from wil_campaign.plugins.doctor import installed, links, machine, ports, programs
from wil_campaign.plugins.doctor.findings import Finding, findings_text
from wil_campaign.safety.guard.process.orphaned_processes import GuardRecord
from wil_campaign.worlds.jit import KernelCache

ROOT = Path(__file__).parents[3]
GONE = ProcessId(2**22 + 1, 1)


def only(findings: Iterable[Finding]) -> Finding:
    (one,) = list(findings)
    return one


def test_findings_are_reported_by_topic_each_with_its_remedy() -> None:
    findings = [
        Finding("ports", "good", "free"),
        Finding("ports", "note", "taken", "end it"),
        Finding("clock", "trouble", "late"),
    ]
    told = "ports\n  ok free\n  -- taken\n     end it\n\nclock\n  !! late"
    assert findings_text(findings) == told


def test_missing_packages_are_named() -> None:
    def find(name: str) -> str:
        if name == "numpy":
            raise PackageNotFoundError(name)
        return "14.0"

    needed = ["av>=14", "numpy>=2", "pytest>=8.3; extra == 'test'"]
    found = only(installed.package_findings(find, lambda _: needed))
    assert (found.grade, found.text, found.remedy) == (
        "trouble",
        "wil-campaign 14.0 lacks numpy",
        "pip install 'numpy>=2'",
    )
    good = only(installed.package_findings(lambda _: "14.0", lambda _: needed))
    assert (good.grade, good.text) == (
        "good",
        "wil-campaign 14.0 with the 2 packages that it needs",
    )


@pytest.mark.parametrize(
    ("has", "good"),
    [("1.26.4", False), ("2.0rc1", True), ("2", True), ("2.9.9", True), ("3.0", False)],
)
def test_a_package_of_another_version_is_named(has: str, good: bool) -> None:
    """It counted among those that are there: one of a system is often too old."""
    found = only(
        installed.package_findings(
            lambda name: has if name == "numpy" else "1.0", lambda _: ["numpy<3,>=2"]
        )
    )
    assert (found.grade == "good") is good
    if not good:
        assert found.text == f"wil-campaign 1.0 needs numpy<3,>=2; numpy {has} is installed"
        assert found.remedy == "pip install 'numpy<3,>=2'"


@pytest.mark.parametrize(("runs_on", "grade"), [("aarch64", "good"), ("x86_64", "trouble")])
def test_a_package_that_a_machine_does_not_need_is_not_missing(
    monkeypatch: pytest.MonkeyPatch, runs_on: str, grade: str
) -> None:
    """On ARM doctor ended with 3, for want of what has no wheel there."""

    def find(name: str) -> str:
        if name == "jsbsim":
            raise PackageNotFoundError(name)
        return "3"

    monkeypatch.setattr("platform.machine", lambda: runs_on)
    needed = ["jsbsim<2,>=1.2.3; platform_machine != 'aarch64'", "numpy>=2"]
    assert only(installed.package_findings(find, lambda _: needed)).grade == grade


def test_a_missing_mavsdk_is_a_note_with_its_remedy() -> None:
    def find(name: str) -> str:
        raise PackageNotFoundError(name)

    assert only(installed.driver_findings(lambda _: "4.1.0")).grade == "good"
    without = only(installed.driver_findings(find))
    assert (without.grade, without.remedy.split(": ", 2)[-1]) == (
        "note",
        "pip install 'mavsdk>=4.1,<5'",
    )


@pytest.mark.parametrize("protocol", ["udp", "tcp"])
def test_a_port_that_is_taken_names_its_holder(
    protocol: ports.Protocol, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where a process has ended since it was listed."""
    listed = os.listdir
    monkeypatch.setattr(os, "listdir", lambda path: ["4194304", *listed(path)])
    kind = socket.SOCK_DGRAM if protocol == "udp" else socket.SOCK_STREAM
    with socket.socket(socket.AF_INET, kind) as mine:
        mine.bind(("127.0.0.1", 0))
        if protocol == "tcp":
            mine.listen()
        number = mine.getsockname()[1]
        found = only(ports.usual_port_findings([ports.UsualPort(number, protocol, "a test")]))
    name = Path("/proc/self/comm").read_text().strip()
    assert found.grade == "note"
    assert found.text == (
        f"{protocol} {number} (a test) is in use by {name} (process {os.getpid()})"
    )
    free = only(ports.usual_port_findings([ports.UsualPort(number, protocol, "a test")]))
    assert (free.grade, free.text) == ("good", f"free: {protocol} {number}")


def test_autopilots_are_found_in_their_usual_places(tmp_path: Path) -> None:
    lacking = list(programs.autopilot_program_findings(tmp_path, lambda _: None))
    assert [one.grade for one in lacking] == ["good", "note", "note", "note"]
    for place in (
        "ardupilot/build/sitl/bin/arducopter",
        "PX4-Autopilot/build/px4_sitl_default/bin/px4",
    ):
        (tmp_path / place).parent.mkdir(parents=True)
        (tmp_path / place).write_text("")
    found = [
        autopilot.text
        for autopilot in programs.autopilot_program_findings(tmp_path, lambda _: None)
    ]
    build = tmp_path / "PX4-Autopilot" / "build" / "px4_sitl_default"
    assert f"PX4: link: {{launch: px4, build: {build}}}" in found
    assert any(text.startswith("ArduCopter: link: {launch: ardupilot") for text in found)


@pytest.mark.parametrize(
    ("body", "grade", "said"),
    [
        ("echo px4io/px4-sitl:v1.18", "good", "images of PX4: px4io/px4-sitl:v1.18"),
        ("echo busybox:1", "note", "without an image of PX4"),
        ("echo 'permission denied' >&2; exit 1", "note", "docker failed: permission denied"),
    ],
)
def test_docker_is_asked_through_its_client(
    tmp_path: Path, body: str, grade: str, said: str
) -> None:
    client = tmp_path / "docker"
    client.write_text(f"#!/bin/sh\n{body}\n")
    client.chmod(0o755)
    which = {"docker": str(client)}.get
    *_, found = programs.autopilot_program_findings(tmp_path, which)
    assert found.grade == grade
    assert said in found.text


def test_the_doctor_grades_clocks_and_scheduling() -> None:
    now = datetime(2026, 5, 1, tzinfo=UTC)
    good = list(machine.clock_findings(0.0004, stalled_s=0.01, synchronised=True, now=now))
    assert [one.grade for one in good] == ["good", "good", "good"]
    bad = datetime(1970, 1, 1, tzinfo=UTC)
    late, stalled, date = machine.clock_findings(0.03, stalled_s=0.16, synchronised=True, now=bad)
    assert (late.grade, late.text) == ("trouble", "wakes up 30.0 ms late")
    assert (stalled.grade, "late by up to 160 ms" in stalled.text) == ("trouble", True)
    assert "--clock virtual" in stalled.remedy
    assert (date.grade, date.text) == ("trouble", "the date is 1970-01-01")
    unsynchronised = machine.clock_findings(0.0, stalled_s=0.0, synchronised=False, now=now)
    assert [one.grade for one in unsynchronised] == ["good", "good", "note"]
    assert machine.wakes_late_s() >= 0.0
    good = list(machine.guard_privileges("real-time", in_memory=True))
    assert [one.grade for one in good] == ["good", "good"]
    busy, short = machine.guard_privileges("normal", in_memory=False)
    assert (busy.grade, "rtprio 1" in busy.remedy) == ("note", True)
    assert (short.grade, "memlock unlimited" in short.remedy) == ("note", True)
    scheduling, _ = machine.granted_to_guard()
    assert scheduling in {"real-time", "nice -10", "normal"}
    assert machine.clock_synchronised() in {True, False, None}


def test_serial_ports_with_and_without_permission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert only(machine.serial_port_findings([])).text == "no serial device is plugged in"
    device = tmp_path / "ttyACM0"
    device.write_text("")
    assert (
        f"serial://{device}:57600" in next(iter(machine.serial_port_findings([str(device)]))).text
    )
    monkeypatch.setattr(os, "access", lambda *_: False)
    refused = next(iter(machine.serial_port_findings([str(device)])))
    assert (refused.grade, refused.text) == ("trouble", f"no permission for {device}")
    assert refused.remedy == "sudo usermod -aG dialout $USER, and log in again"


def test_processes_and_backups_that_a_crash_left_are_named(tmp_path: Path) -> None:
    assert only(machine.orphan_findings((), (), tmp_path / "nothing")).text == "nothing"
    (tmp_path / "000001.parameters.json").write_text("{}")
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        alive = ProcessId.of(child.pid)
        assert alive is not None
        record = GuardRecord(
            run="large/wil/1",
            folder="results",
            socket="",
            guard=GONE,
            owner=GONE,
            since_s=0.0,
            children=(alive,),
        )
        vehicles, parameters = machine.orphan_findings((), [record], tmp_path)
        assert vehicles.grade == "trouble"
        assert (
            f"vehicles of large/wil/1 in results still run (processes {child.pid})" in vehicles.text
        )
        assert "000001.parameters.json" in parameters.text
        child.communicate(b"\n", timeout=60.0)


def test_a_full_disk_and_a_foreign_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "_LEAST_FREE_BYTES", 1)
    assert only(machine.disk_finding(tmp_path)).grade == "good"
    monkeypatch.setattr(machine, "_LEAST_FREE_BYTES", 10**30)
    assert only(machine.disk_finding(tmp_path)).grade == "trouble"
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert "is not writable" in only(machine.disk_finding(tmp_path)).text


@pytest.mark.parametrize("below", ["", "deep/er"])
def test_results_where_a_file_is_are_trouble(tmp_path: Path, below: str) -> None:
    """It was good, by the space in the folder of that file; `run` refused it."""
    (tmp_path / "file").write_text("")
    found = only(machine.disk_finding(tmp_path / "file" / below))
    assert (found.grade, found.text) == ("trouble", f"{tmp_path / 'file'} is no folder")


def test_links_of_campaigns_are_tried(tmp_path: Path) -> None:
    shipped = ROOT / "campaigns" / "gate.yaml"
    assert only(links.campaign_link_findings([shipped])).text.endswith("its vehicles are embedded")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mine:
        mine.bind(("127.0.0.1", 0))
        port = mine.getsockname()[1]
        text = shipped.read_text().replace(
            "real:\n    link: embedded", f"real:\n    link: udpin://127.0.0.1:{port}", 1
        )
        assert str(port) in text
        copy = tmp_path / "campaigns" / "gate.yaml"
        copy.parent.mkdir()
        copy.write_text(text.replace("pose_source: mocap", "pose_source: mavlink"))
        (copy.parent / "autonomies").symlink_to(ROOT / "campaigns" / "autonomies")
        for name in ("worlds", "recipes"):
            (tmp_path / name).symlink_to(ROOT / name)
        busy = only(links.campaign_link_findings([copy]))
        assert busy.grade == "trouble", busy
        assert "is in use by another program" in busy.text
    good = only(links.campaign_link_findings([copy]))
    assert (good.grade, good.remedy) == (
        "good",
        "to see which vehicle answers: wil-campaign run --no-arm",
    )


def test_the_command_tells_it_as_json_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    code = main(["doctor", "--json", "--out", str(tmp_path)])
    findings = json.loads(capsys.readouterr().out)
    grades = {finding["grade"] for finding in findings}
    assert code == (3 if "trouble" in grades else 0)
    assert {finding["topic"] for finding in findings} >= {
        "installed",
        "ports",
        "autopilots",
        "clock",
    }
    assert main(["doctor", "--out", str(tmp_path), str(tmp_path / "missing.yaml")]) == 3
    assert "wil-campaign validate" in capsys.readouterr().out


def test_a_missing_driver_or_broker_keeps_a_campaign_from_flying(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    port, file = free_port(), write_wall(tmp_path)
    text = file.read_text().replace(
        "autopilot: ardupilot}", "autopilot: ardupilot, driver: mavsdk}"
    )
    file.write_text(f"{text}operator: {{mqtt: {{broker: 'mqtt://127.0.0.1:{port}'}}}}\n")
    with socket.create_server(("127.0.0.1", port)):
        assert [campaign_link.grade for campaign_link in links.campaign_link_findings([file])] == [
            "good",
            "good",
        ]
    monkeypatch.setattr(links, "is_package_installed", lambda _: False)
    _, driver, broker = links.campaign_link_findings([file])
    assert (driver.grade, broker.grade) == ("trouble", "trouble")
    assert driver.text == f"{file}: twin: the driver mavsdk is not installed"
    assert f"{file}: the broker mqtt://127.0.0.1:{port} does not answer" in broker.text


def test_the_doctor_says_where_kernels_are_cached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = only(machine.kernel_cache_finding(KernelCache(tmp_path / "kernels-1", ())))
    assert (good.grade, good.text) == (
        "good",
        f"compiled kernels are cached in {tmp_path}/kernels-1, which is writable",
    )
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    last = only(
        machine.kernel_cache_finding(KernelCache(tmp_path / "kernels-1", ("/a is not writable",)))
    )
    assert (last.grade, last.text.rpartition(", ")[2]) == (
        "note",
        "which may not be kept: /a is not writable",
    )
    none = only(machine.kernel_cache_finding(KernelCache(None, ("/a is not writable",))))
    assert none.grade == "note"
    assert none.text.startswith("compiled kernels are cached nowhere")
    assert last.remedy == none.remedy == "set NUMBA_CACHE_DIR to a folder of your own that is kept"


def test_the_doctor_says_where_sockets_are(
    short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))
    found = only(machine.socket_folder_finding())
    assert (found.grade, found.text) == ("good", f"sockets are in {short_folder}/wil-campaign")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder / ("x" * 90)))
    found = only(machine.socket_folder_finding())
    assert found.grade == "note"
    assert found.text.startswith("XDG_RUNTIME_DIR is too long for paths of sockets; ")


def test_results_in_a_folder_that_is_not_utf8_are_trouble(tmp_path: Path) -> None:
    found = only(machine.disk_finding(tmp_path / os.fsdecode(b"n\xff")))
    assert found.grade == "trouble"
    assert found.text.endswith("in its path is not UTF-8: rename it")


def test_a_user_without_a_home_is_examined(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def unknown(uid: int) -> None:
        raise KeyError(uid)

    for name in ("HOME", "XDG_STATE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    monkeypatch.setattr(machine, "granted_to_guard", lambda: ("normal", False))
    main(["doctor", "--out", str(tmp_path)])
    assert "has no home folder for the backups" in capsys.readouterr().out
