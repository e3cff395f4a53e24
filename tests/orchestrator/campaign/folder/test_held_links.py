"""A link of an attached vehicle is one program's, also where a router would serve two."""

import fcntl
import os
from pathlib import Path

import pytest

from tests.ports import free_port
from wil_campaign.orchestrator.campaign.folder import bench_lock
from wil_campaign.orchestrator.campaign.folder.bench_lock import held_links
from wil_campaign.orchestrator.campaign.folder.campaign_folder import FolderTakenError, OutputError
from wil_campaign.orchestrator.cli import engine_flight, main
from wil_campaign.vehicles.links.link_strings import parse_link

_RUNTIME = "wil_campaign.safety.guard.process.runtime_folder"
LINK = parse_link("udpout://127.0.0.1:14550")
OTHER = parse_link("udpout://127.0.0.1:14551")


@pytest.fixture(autouse=True)
def runtime(short_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))
    monkeypatch.setenv("HOME", str(short_folder))
    return short_folder / "wil-campaign"


def test_a_link_is_held_by_one_and_nothing_is_left(runtime: Path) -> None:
    with held_links((LINK, LINK)), held_links((OTHER,)):
        with pytest.raises(FolderTakenError, match=f"the vehicle at {LINK} is in use"):
            held_links((OTHER, LINK)).__enter__()
        assert len(list(runtime.iterdir())) == 2
    with held_links((LINK,)):
        pass
    assert list(runtime.iterdir()) == []


def test_a_link_is_held_in_every_session_of_the_account(
    short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    login = short_folder / str(os.getuid())
    login.mkdir(mode=0o700)
    monkeypatch.setattr(f"{_RUNTIME}._LOGINS", short_folder)
    monkeypatch.setattr(f"{_RUNTIME}._TEMPORARY", short_folder)
    for mine, others in ((str(login), ""), ("", str(login))):
        monkeypatch.setenv("XDG_RUNTIME_DIR", mine)
        with held_links((LINK,)):
            monkeypatch.setenv("XDG_RUNTIME_DIR", others)
            with pytest.raises(FolderTakenError):
                held_links((LINK,)).__enter__()


def test_a_file_that_its_holder_removes_meanwhile_holds_nothing(
    runtime: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flock, removed = fcntl.flock, list[Path]()

    def lock(handle: int, how: int) -> None:
        if not removed:
            removed.extend(runtime.iterdir())
            removed[0].unlink()
        flock(handle, how)

    monkeypatch.setattr("fcntl.flock", lock)
    with held_links((LINK,)):
        assert list(runtime.iterdir()) == removed
        with pytest.raises(FolderTakenError):
            held_links((LINK,)).__enter__()


def test_a_lock_that_cannot_be_written_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path) -> int:
        raise OSError(30, "Read-only file system", str(path))

    monkeypatch.setattr(bench_lock, "_lock_file", refuse)
    with pytest.raises(OutputError, match=r"cannot be locked: .*Read-only file system"):
        held_links((LINK,)).__enter__()


def test_a_vehicle_in_use_is_not_touched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(engine_flight, "start_run_server", lambda: None)
    link = f"udpout://127.0.0.1:{free_port()}"
    words = ["run", "campaigns/gate.yaml", "--no-arm", "--out", str(tmp_path / "out")]
    sets = ("--set", f"vehicles.real.link={link}", "--set", "vehicles.real.pose_source=mavlink")
    with held_links((parse_link(link),)):
        assert main([*words, *sets]) == 3
    said = capsys.readouterr().err
    assert said.startswith(f"the vehicle at {link} is in use by another wil-campaign: wait until")
