"""The folder of sockets is this user's alone, whatever others put in its place."""

import os
import pwd
import socket
from pathlib import Path

import pytest

from wil_campaign.foundation.processes.identity import ProcessId
from wil_campaign.orchestrator.operator.campaign_records import CampaignRecord, operator_places
from wil_campaign.safety.guard.process.orphaned_processes import (
    GuardRecord,
    reap_orphans,
    running_guards,
    write_guard_record,
)
from wil_campaign.safety.guard.process.runtime_folder import (
    RuntimeFolderError,
    open_runtime_folder,
    process_socket_path,
    runtime_folders,
    sweep_runtime_folder,
    unsafe_folders,
)
from wil_campaign.vehicles.driver.onboard.crash_safe_file import CrashSafeFile

_MODULE = "wil_campaign.safety.guard.process.runtime_folder"


@pytest.fixture(autouse=True)
def usual(short_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the place that is used where nothing is in the way."""
    for variable, name in (("XDG_RUNTIME_DIR", "run"), ("HOME", "home")):
        (short_folder / name).mkdir(mode=0o700)
        monkeypatch.setenv(variable, str(short_folder / name))
    return short_folder / "run" / "wil-campaign"


@pytest.fixture
def other(short_folder: Path) -> Path:
    return short_folder / "home" / ".local" / "state" / "wil-campaign" / "run"


def test_the_usual_folder_is_ours_alone(usual: Path) -> None:
    assert open_runtime_folder().path == usual
    assert usual.stat().st_mode & 0o777 == 0o700
    assert open_runtime_folder().passed_over == ()


@pytest.mark.parametrize("trap", ["open", "link", "file", "shared"])
def test_a_folder_that_others_made_is_reported_and_another_used(
    usual: Path, other: Path, tmp_path: Path, trap: str
) -> None:
    match trap:
        case "open":
            usual.mkdir()
            usual.chmod(0o777)
        case "link":
            usual.symlink_to(tmp_path)
        case "file":
            usual.write_text("in the way")
        case "shared":
            usual.parent.chmod(0o777)
    opened = open_runtime_folder()
    assert opened.path == other
    said = {
        "open": "is open to other users (mode 0777)",
        "link": "is a symbolic link",
        "file": "cannot be made: File exists",
        "shared": f"can be replaced by other users, who may write to {usual.parent}",
    }
    assert opened.passed_over == (f"{usual} {said[trap]}",)
    assert list(tmp_path.iterdir()) == []


def test_parameter_backups_in_the_same_place_are_not_in_the_way(usual: Path, other: Path) -> None:
    CrashSafeFile.write(other.parent / "parameters", ".parameters.json", {}).remove()
    assert unsafe_folders() == ()
    usual.write_text("in the way")
    assert open_runtime_folder().path == other
    assert other.stat().st_mode & 0o777 == 0o700


def test_a_folder_of_another_user_is_not_used(
    usual: Path, other: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual.mkdir(mode=0o700)
    other.mkdir(parents=True, mode=0o700)
    mine = os.getuid()
    monkeypatch.setattr("os.getuid", lambda: mine + 1)
    with pytest.raises(RuntimeFolderError, match=f"belongs to another user .uid {mine}."):
        open_runtime_folder()


def test_a_flight_is_found_where_it_began(usual: Path, other: Path, tmp_path: Path) -> None:
    """The trap is gone when somebody wants to abort."""
    usual.mkdir()
    usual.chmod(0o777)
    record = CampaignRecord(name="gate", folder=tmp_path)
    with record:
        assert record.passed_over[0].endswith(f"; {other} is used")
        usual.rmdir()
        assert [campaign.name for campaign in operator_places().campaigns] == ["gate"]
        assert record.socket.parent == other
        assert runtime_folders() == (other,)


@pytest.mark.parametrize("began", ["login", "shell"])
def test_a_flight_is_found_from_the_users_other_sessions(
    short_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, began: str
) -> None:
    """A login by systemd has an XDG_RUNTIME_DIR; cron, `su` and `docker exec` have none."""
    login = short_folder / str(os.getuid())
    login.mkdir(mode=0o700)
    monkeypatch.setattr(f"{_MODULE}._LOGINS", short_folder)
    monkeypatch.setattr(f"{_MODULE}._TEMPORARY", short_folder / "run")

    def come_in_by(session: str) -> None:
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(login) if session == "login" else "")

    come_in_by(began)
    with CampaignRecord(name="gate", folder=tmp_path):
        for session in ("login", "shell"):
            come_in_by(session)
            assert [campaign.name for campaign in operator_places().campaigns] == ["gate"]
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder / "home"))
        assert operator_places().campaigns == ()  # as where a test flies beside a real vehicle


def test_files_of_dead_processes_are_removed(usual: Path) -> None:
    folder = open_runtime_folder().path
    assert folder == usual
    alive = folder / f"campaign-{os.getpid()}.sock"
    stays = (alive, folder / "guard-4194303-77.json", folder / "notes.sock")
    for path in stays:
        path.touch()
    for name in ("campaign-4194303.sock", "guard-4194303.sock", "guard-4194303-77.part"):
        (folder / name).touch()
    sweep_runtime_folder(folder)
    assert sorted(folder.iterdir()) == sorted(stays)


def test_what_a_process_of_a_container_serves_in_the_folder_stays() -> None:
    """Its process ids mean nothing here; its program and its guard fly."""
    folder = open_runtime_folder().path
    campaign, console = (folder / f"{name}-4194303.sock" for name in ("campaign", "console"))
    guard = ProcessId(4194303, 77)
    record = GuardRecord(
        run="1", folder="/1", socket=str(campaign), guard=guard, owner=None, since_s=1.0
    )
    with (
        socket.socket(socket.AF_UNIX) as end,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as feed,
    ):
        end.bind(str(campaign))
        end.listen()
        feed.bind(str(console))
        write_guard_record(folder, record)
        sweep_runtime_folder(folder)
        assert reap_orphans(folder) == ()
        assert running_guards(folder) == (record,)
        assert {campaign, console} < {*folder.iterdir()}
    assert running_guards(folder) == ()
    reap_orphans(folder)
    sweep_runtime_folder(folder)
    assert list(folder.iterdir()) == []


def test_programs_of_two_containers_have_sockets_of_their_own(usual: Path) -> None:
    one, other = (process_socket_path(usual, "guard", ProcessId(1, at)) for at in (700, 1 << 36))
    assert one != other
    assert max(len(path.name) for path in (one, other)) <= len("pymp-abcdefgh/listener-abcdefgh")


def test_a_user_without_a_home_has_the_usual_folder_alone(
    usual: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unknown(uid: int) -> None:
        raise KeyError(uid)

    monkeypatch.delenv("HOME")
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    assert open_runtime_folder().path == usual
    usual.rmdir()
    usual.write_text("in the way")
    with pytest.raises(RuntimeFolderError, match="set XDG_RUNTIME_DIR to a folder of your own"):
        open_runtime_folder()


def test_a_folder_too_deep_for_sockets_of_multiprocessing_is_not_used(
    short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    long = short_folder / ("x" * 60)
    long.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(long))
    path = open_runtime_folder().path / "pymp-abcdefgh" / "listener-abcdefgh"
    assert not path.is_relative_to(long)
    assert len(os.fsencode(path)) <= 107
