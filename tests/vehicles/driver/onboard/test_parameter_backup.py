"""Parameters changed for a time: set back in reverse, and after a crash by the next start."""

import asyncio
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vehicles.driver.onboard.slow_disks import SlowDisk, end_threads
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.vehicles.driver.onboard import disk_access
from wil_campaign.vehicles.driver.onboard.crash_safe_file import CrashSafeFile
from wil_campaign.vehicles.driver.onboard.parameter_backup import (
    ParameterBackup,
    ParameterValue,
    RestoredParameters,
    restore_backups,
)
from wil_campaign.vehicles.driver.onboard.parameters import _as_float32
from wil_campaign.vehicles.errors import ParameterError


class Access:
    """Parameters in a dict; `stuck` do not take a value, floats lose what a float32 loses."""

    def __init__(self, **values: ParameterValue) -> None:
        self.values = dict(values)
        self.log: list[tuple[str, ParameterValue]] = []
        self.stuck: set[str] = set()

    async def get(self, name: str) -> ParameterValue:
        if name not in self.values:
            raise ParameterError(f"no {name}")
        return self.values[name]

    async def set(self, name: str, value: ParameterValue) -> None:
        if name in self.stuck:
            raise ParameterError(f"{name} is stuck")
        self.values[name] = _as_float32(value) if isinstance(value, float) else value
        self.log.append((name, value))


def context(
    access: Access, changes: dict[str, ParameterValue], journal: Path | None = None
) -> ParameterBackup:
    return ParameterBackup(access=access, vehicle="px4 1 7", changes=changes, folder=journal)


def test_parameters_are_set_in_order_and_set_back_in_reverse(tmp_path: Path) -> None:
    access = Access(A=1, B=2.5, C=3)

    def backups() -> list[str]:
        return [path.name for path in tmp_path.iterdir()]

    async def scenario() -> None:
        async with context(access, {"B": 0.1, "A": 9}, tmp_path):
            assert access.values == {"A": 9, "B": _as_float32(0.1), "C": 3}
            assert backups() == ["000001.parameters.json"]

    run_virtual(scenario())
    assert access.values == {"A": 1, "B": 2.5, "C": 3}
    assert access.log == [("B", 0.1), ("A", 9), ("A", 1), ("B", 2.5)]
    assert list(tmp_path.iterdir()) == []


def test_nothing_stays_changed_when_one_is_refused() -> None:
    access = Access(A=1, B=2)
    access.stuck = {"B"}

    async def scenario() -> None:
        async with context(access, {"A": 5, "B": 6}):
            raise AssertionError("entered")

    with pytest.raises(ParameterError, match="B is stuck") as caught:
        run_virtual(scenario())
    assert access.values == {"A": 1, "B": 2}
    assert "could not restore B" in caught.value.__notes__[0]


def test_an_unknown_parameter_changes_none() -> None:
    access = Access(A=1)

    async def scenario() -> None:
        async with context(access, {"A": 5, "NOPE": 6}):
            raise AssertionError("entered")

    with pytest.raises(ParameterError, match="no NOPE"):
        run_virtual(scenario())
    assert access.log == []


def test_the_backup_stays_when_one_cannot_be_set_back(tmp_path: Path) -> None:
    access = Access(A=1, B=2)

    async def scenario() -> None:
        async with context(access, {"A": 5, "B": 6}, tmp_path):
            access.stuck = {"A"}

    with pytest.raises(
        ParameterError, match=r"could not restore A to 1 .*the next start tries again"
    ):
        run_virtual(scenario())
    assert access.values == {"A": 5, "B": 2}
    access.stuck = set()
    restored = run_virtual(restore_backups(tmp_path, access=access, vehicle="px4 1 7"))
    assert access.values == {"A": 1, "B": 2}
    assert [change.name for change in restored.restored] == ["B", "A"]
    assert list(tmp_path.iterdir()) == []


def test_the_error_of_the_flight_itself_is_raised(tmp_path: Path) -> None:
    access = Access(A=1)

    async def scenario() -> None:
        async with context(access, {"A": 5}, tmp_path):
            access.stuck = {"A"}
            raise RuntimeError("of the flight")

    with pytest.raises(RuntimeError, match="of the flight") as caught:
        run_virtual(scenario())
    assert "could not restore A" in caught.value.__notes__[0]


def test_the_loop_runs_on_while_the_disk_takes_the_backup(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario() -> None:
        access, disk = Access(A=1), SlowDisk(monkeypatch)
        backup = context(access, {"A": 5}, tmp_path)
        entering = asyncio.create_task(backup.__aenter__())
        waiting = asyncio.create_task(disk.reached())
        await asyncio.wait({entering, waiting}, return_when=asyncio.FIRST_COMPLETED)
        assert access.log == []
        disk.release()
        await entering
        assert access.values == {"A": 5}
        await backup.__aexit__(None, None, None)

    run_virtual(scenario())
    assert list(tmp_path.iterdir()) == []


def test_an_entry_that_is_cancelled_leaves_no_backup(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario() -> None:
        access, disk = Access(A=1), SlowDisk(monkeypatch)
        entering = asyncio.create_task(context(access, {"A": 5}, tmp_path).__aenter__())
        await disk.reached()
        entering.cancel()
        await asyncio.sleep(0)
        disk.release()
        with pytest.raises(asyncio.CancelledError):
            await entering
        assert access.log == []

    run_virtual(scenario())
    assert list(tmp_path.iterdir()) == []


def test_a_dead_disk_is_an_error_and_its_late_backup_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario() -> None:
        access, disk = Access(A=1), SlowDisk(monkeypatch)
        said = f"the parameter backup in {tmp_path} cannot be written .the disk takes nothing"
        with pytest.raises(ParameterError, match=said):
            await context(access, {"A": 5}, tmp_path).__aenter__()
        assert access.log == []
        disk.release()
        await asyncio.to_thread(end_threads, "parameter backup")

    monkeypatch.setattr(disk_access, "_MOST_POLLS", 2)
    run_virtual(scenario())
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_dies_before_the_backup_is_removed_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    removed, released = CrashSafeFile.remove, threading.Event()

    def remove(file: CrashSafeFile) -> None:
        assert released.wait(20.0)
        removed(file)

    async def scenario() -> None:
        access = Access(A=1)
        backup = await context(access, {"A": 5}, tmp_path).__aenter__()
        monkeypatch.setattr(disk_access, "_MOST_POLLS", 2)  # only now: a real disk has written
        said = "are restored, but their backup .*000001.* cannot be removed .the disk takes nothing"
        with pytest.raises(ParameterError, match=said):
            await backup.__aexit__(None, None, None)
        assert access.values == {"A": 1}

    monkeypatch.setattr(CrashSafeFile, "remove", remove)
    try:
        run_virtual(scenario())
        assert len(list(tmp_path.iterdir())) == 1
    finally:
        released.set()
        end_threads("parameter backup")
    assert list(tmp_path.iterdir()) == []


_KILLED = """
import asyncio, os, signal, sys
from pathlib import Path
from tests.vehicles.driver.onboard.test_parameter_backup import Access, context
async def main():
    access = Access(A=1, B=2.1)
    async with context(access, {"A": 5, "B": 0.7}, Path(sys.argv[1])):
        os.kill(os.getpid(), signal.SIGKILL)
asyncio.run(main())
"""


def killed_run(folder: Path) -> None:
    ended = subprocess.run(  # noqa: S603 - ours
        [sys.executable, "-c", _KILLED, str(folder)], check=False, timeout=60
    )
    assert ended.returncode == -signal.SIGKILL


def test_parameters_that_a_killed_run_left_are_set_back(tmp_path: Path) -> None:
    killed_run(tmp_path)
    # It set them; B has been changed by somebody since, which is none of our business.
    access = Access(A=5, B=3.3)
    restored = run_virtual(restore_backups(tmp_path, access=access, vehicle="px4 1 7"))
    assert access.values == {"A": 1, "B": 3.3}
    assert [change.name for change in restored.restored] == ["A"]
    assert [change.name for change in restored.foreign] == ["B"]
    assert list(tmp_path.iterdir()) == []


def test_a_value_that_no_float_holds_exactly_is_known_again(tmp_path: Path) -> None:
    killed_run(tmp_path)
    access = Access(A=5, B=_as_float32(0.7))
    restored = run_virtual(restore_backups(tmp_path, access=access, vehicle="px4 1 7"))
    assert restored.foreign == ()
    assert access.values == {"A": 1, "B": _as_float32(2.1)}


def test_backups_of_others_and_of_the_living_are_left_alone(tmp_path: Path) -> None:
    killed_run(tmp_path)
    access = Access(A=5, B=0.7)
    other = run_virtual(restore_backups(tmp_path, access=access, vehicle="px4 2 8"))
    assert other == RestoredParameters()
    assert len(list(tmp_path.iterdir())) == 1

    async def scenario() -> RestoredParameters:
        async with context(Access(A=1), {"A": 4}, tmp_path / "living"):
            return await restore_backups(tmp_path / "living", access=Access(A=4), vehicle="px4 1 7")

    assert run_virtual(scenario()) == RestoredParameters()


def test_several_backups_are_set_back_newest_first(tmp_path: Path) -> None:
    killed_run(tmp_path)
    # A second run began with A at 5, as the first had left it, and was killed as well.
    first = next(tmp_path.iterdir())
    second = tmp_path / "000002.parameters.json"
    second.write_text(first.read_text().replace('["A", 1, 5]', '["A", 5, 8]'))
    access = Access(A=8, B=0.7)
    run_virtual(restore_backups(tmp_path, access=access, vehicle="px4 1 7"))
    assert access.values["A"] == 1


def test_a_backup_that_cannot_be_restored_is_named_and_the_rest_of_it_is(tmp_path: Path) -> None:
    """As after an update of the firmware, which has another name for the parameter."""
    killed_run(tmp_path)
    access = Access(A=5)
    with pytest.raises(ParameterError) as refused:
        run_virtual(restore_backups(tmp_path, access=access, vehicle="px4 1 7"))
    (backup,) = tmp_path.iterdir()
    assert str(refused.value) == (
        "could not restore what an earlier run changed: B to 2.1 (no B); try again, or set it "
        f"yourself and remove {backup}"
    )
    assert access.values == {"A": 1}


def test_a_file_that_is_no_backup_is_named(tmp_path: Path) -> None:
    (tmp_path / "000001.parameters.json").write_text("{")
    with pytest.raises(ParameterError, match=r"000001.parameters.json is not a parameter backup"):
        run_virtual(restore_backups(tmp_path, access=Access(), vehicle="x"))


def test_without_a_backup_nothing_is_changed(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    check_no_backup(tmp_path / "file" / "in")


def check_no_backup(folder: Path) -> None:
    access = Access(A=1)

    async def scenario() -> None:
        async with context(access, {"A": 5}, folder):
            raise AssertionError("entered")

    with pytest.raises(ParameterError, match="cannot be written"):
        run_virtual(scenario())
    assert access.log == []


@given(
    st.dictionaries(
        st.sampled_from("ABCDE"),
        st.one_of(st.integers(-(2**31), 2**31 - 1), st.floats(width=32, allow_nan=False)),
    ),
    st.sets(st.sampled_from("ABCDE"), max_size=2),
)
def test_all_that_can_be_set_back_is_as_before(
    changes: dict[str, ParameterValue], stuck: set[str]
) -> None:
    access = Access(A=1, B=2, C=3.5, D=4, E=5)
    before = dict(access.values)

    async def scenario() -> None:
        access.stuck = stuck
        async with context(access, changes):
            assert not stuck & set(changes)

    try:
        run_virtual(scenario())
    except ParameterError:
        assert stuck & set(changes)
    assert access.values == before
