"""Files that a thread writes: a pipe that nobody reads is the disk that stands still."""

import fcntl
import os
import threading
import time
from collections.abc import Callable
from io import FileIO
from pathlib import Path

import pytest

from wil_campaign.foundation import background_file
from wil_campaign.foundation.background_file import BackgroundFile, DiskPatience

BLOCK = b"." * 1000


class Stalled:
    """A file on a disk that takes nothing until it is released."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "pipe"
        os.mkfifo(self.path)
        self._end = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK)
        fcntl.fcntl(self._end, fcntl.F_SETPIPE_SZ, 4096)
        self._reader = threading.Thread(target=self._read)
        self._data = bytearray()

    def release(self) -> None:
        """Take all, and go on so."""
        os.set_blocking(self._end, True)
        self._reader.start()

    def data(self) -> bytes:
        """Return all that was written, once its writer has closed it."""
        self._reader.join()
        os.close(self._end)
        return bytes(self._data)

    def _read(self) -> None:
        while data := os.read(self._end, 65536):
            self._data += data


def write(file: BackgroundFile, blocks: int) -> None:
    for _ in range(blocks):
        file.write(BLOCK)
        file.flush()


@pytest.fixture
def stalled(tmp_path: Path) -> Stalled:
    return Stalled(tmp_path)


def test_a_disk_that_stands_still_holds_up_no_writer_and_gets_all_in_order(
    stalled: Stalled,
) -> None:
    file = BackgroundFile(stalled.path, append=True)
    lines = [b"%d\n" % number + BLOCK for number in range(1000)]
    for line in lines:
        assert file.write(line) == len(line)
        file.flush()
    file.flush(0.01)
    stalled.release()
    file.close()
    assert stalled.data() == b"".join(lines)


def test_a_wait_for_the_disk_ends_when_it_has_all(tmp_path: Path) -> None:
    file = BackgroundFile(tmp_path / "file")
    for number in range(100):
        file.write(b"%d" % (number % 10))
        file.flush(60.0)
        assert file._behind_bytes == 0
        assert (tmp_path / "file").stat().st_size == number + 1
    file.close()
    file.close()


def test_a_writer_waits_once_and_then_no_more_until_the_disk_has_caught_up(
    stalled: Stalled, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = BackgroundFile(stalled.path, append=True)
    waits: list[float | None] = []
    wait_for = file._taken.wait_for

    def count(predicate: Callable[[], bool], within_s: float | None = None) -> bool:
        waits.append(within_s)
        return wait_for(predicate, within_s)

    monkeypatch.setattr(file._taken, "wait_for", count)
    file.write(10 * BLOCK)
    for _ in range(20):
        file.write(BLOCK)
        file.flush(0.01)
    assert waits == [0.01]
    stalled.release()
    while file._behind_bytes:
        time.sleep(0.01)
    file.write(BLOCK)
    file.flush(60.0)
    assert waits == [0.01, 60.0]
    file.close()
    assert stalled.data() == 31 * BLOCK


def _move_folder(path: Path) -> None:
    path.parent.rename(path.parent.with_name(f"moved-{path.parent.name}"))


@pytest.mark.parametrize("take", [Path.unlink, _move_folder])
def test_a_removed_or_moved_file_is_known_once_it_was_written_to_and_at_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, take: Callable[[Path], object]
) -> None:
    seen = []
    for is_written in (True, False):
        home = tmp_path / f"written-{is_written}"
        home.mkdir()
        monkeypatch.chdir(home.parent)
        file = BackgroundFile(Path(home.name) / "file")
        monkeypatch.chdir("/")
        file.write(BLOCK)
        file.flush(60.0)
        take(home / "file")
        assert not file.is_removed
        if is_written:
            file.write(BLOCK)
            file.flush(60.0)
        seen.append(file.is_removed)
        file.close()
        assert file.is_removed
    assert seen == [True, False]


def test_only_the_thread_looks_at_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a network folder, too, this may take seconds."""
    threads, fstat = [], os.fstat
    file = BackgroundFile(tmp_path / "file")

    def look(descriptor: int) -> os.stat_result:
        threads.append(threading.get_ident())
        return fstat(descriptor)

    monkeypatch.setattr(os, "fstat", look)
    write(file, 3)
    assert not file.is_removed
    file.flush(60.0)
    file.close()
    assert set(threads) == {file._thread.ident}


def test_a_thread_calls_its_begin_function_first(tmp_path: Path) -> None:
    threads: list[int] = []
    file = BackgroundFile(tmp_path / "file", begin=lambda: threads.append(threading.get_ident()))
    file.close()
    assert threads == [file._thread.ident]


def test_a_file_that_is_there_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    with pytest.raises(FileExistsError):
        BackgroundFile(tmp_path / "file")
    file = BackgroundFile(tmp_path / "file", append=True)
    file.write(b", and more")
    file.close()
    assert (tmp_path / "file").read_text() == "kept, and more"


def test_an_error_of_a_full_disk_is_raised_by_later_calls_and_by_the_end() -> None:
    file = BackgroundFile(Path("/dev/full"), append=True)
    file.write(b"lost")
    with pytest.raises(OSError, match="No space left on device"):
        file.flush(60.0)
    for _ in range(100):
        # A library that writes into it must not be the one that gets the error.
        assert file.write(100 * BLOCK) == 100_000
        assert file._buffered_bytes < 100_000
        with pytest.raises(OSError, match="No space left on device") as refused:
            file.flush()
    assert len(refused.traceback) < 10
    with pytest.raises(OSError, match="No space left on device"):
        file.close()
    file.close()


def test_no_error_of_the_thread_is_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken(FileIO):
        def write(self, _: object) -> int:
            raise KeyError("of ours")

    file = BackgroundFile(tmp_path / "file")
    with file._file:
        monkeypatch.setattr(file, "_file", Broken(tmp_path / "file", "ab"))
    file.write(b"lost")
    with pytest.raises(KeyError, match="of ours"):
        file.close()


def test_a_writer_that_must_not_wait_has_an_error_at_the_limit(
    stalled: Stalled, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(background_file, "_MOST_BEHIND_BYTES", 10_000)
    file = BackgroundFile(stalled.path, append=True, waits=False)
    refused = r"the disk takes nothing, and [\d.]+ MB wait for it"
    with pytest.raises(OSError, match=refused):
        write(file, 20)
    for _ in range(200):
        with pytest.raises(OSError, match=refused):
            write(file, 1)
    assert file._queue.qsize() < 20
    stalled.release()
    with pytest.raises(OSError, match=refused):
        file.close()
    # It ends with what was given before: 10 blocks, and those that the pipe had taken.
    data = stalled.data()
    assert data == len(data) // len(BLOCK) * BLOCK
    assert 10 <= len(data) // len(BLOCK) <= 14


def test_a_writer_that_may_wait_waits_at_the_limit_and_loses_nothing(
    stalled: Stalled, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(background_file, "_MOST_BEHIND_BYTES", 10_000)
    file = BackgroundFile(stalled.path, append=True)
    waits, wait_for = threading.Event(), file._taken.wait_for

    def report(predicate: Callable[[], bool]) -> bool:
        waits.set()
        return wait_for(predicate)

    monkeypatch.setattr(file._taken, "wait_for", report)
    writer = threading.Thread(target=write, args=(file, 100))
    writer.start()
    assert waits.wait(60.0)
    assert 0 < file._behind_bytes <= 10_000
    assert writer.is_alive()
    stalled.release()
    writer.join()
    file.close()
    assert stalled.data() == 100 * BLOCK


def test_an_end_that_no_disk_takes_is_an_error(
    stalled: Stalled, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(background_file, "_MOST_POLLS", 2)
    monkeypatch.setattr(background_file, "_LEAST_POLLS", 2)
    file = BackgroundFile(stalled.path, append=True)
    monkeypatch.setattr(file, "_patience", DiskPatience())
    file.write(10 * BLOCK)
    with pytest.raises(TimeoutError, match=r"the disk takes nothing, 0\.0 MB are lost"):
        file.close()
    stalled.release()
    assert len(stalled.data()) == 10_000


def test_a_slow_disk_is_waited_for_while_it_takes_something() -> None:
    """All files of a process wait together: after a first one the others add half a second each."""
    patience = DiskPatience()
    assert all(patience.waits_on(poll) for poll in range(240))
    patience.renew()
    assert all(patience.waits_on(poll) for poll in range(240))
    assert not patience.waits_on(240)
    for _ in range(3):
        assert [patience.waits_on(poll) for poll in range(11)] == 10 * [True] + [False]
    patience.renew()
    assert all(patience.waits_on(poll) for poll in range(240))


@pytest.mark.parametrize(("is_brief", "in_all"), [(False, 800), (True, 240)])
def test_a_slow_disk_is_not_waited_for_without_end(*, is_brief: bool, in_all: int) -> None:
    """The pool kills the process of a run after 60 s, and a guard's end is waited for 15 s."""
    patience = DiskPatience()
    waits = []
    for poll in range(1000):
        waits.append(patience.waits_on(poll, is_brief=is_brief))
        patience.renew()
    assert waits == (in_all - 40) * [True] + (1040 - in_all) * [False]

    patience = DiskPatience()
    polls = 0
    while polls < 1000 and patience.waits_on(polls, is_brief=is_brief):
        patience.renew()
        polls += 1
    # Later ones have their half second each of what is left, and then nothing.
    later = [[patience.waits_on(poll, is_brief=is_brief) for poll in range(10)] for _ in range(5)]
    assert polls == in_all - 40
    assert [sum(waits) for waits in later] == [10, 10, 10, 9, 0]


def test_the_files_of_a_later_run_have_patience_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patience = DiskPatience()
    monkeypatch.setattr(background_file, "patience", patience)
    for _ in range(1000):
        patience.waits_on(0)
    assert not patience.waits_on(0)
    file = BackgroundFile(tmp_path / "file")
    assert all(patience.waits_on(poll) for poll in range(240))
    file.close()


def test_a_good_disk_is_waited_for_when_others_have_used_up_all_patience(tmp_path: Path) -> None:
    file = BackgroundFile(tmp_path / "file")
    for _ in range(1000):
        file._patience.waits_on(0)
    file.write(BLOCK)
    file.close()
    assert (tmp_path / "file").read_bytes() == BLOCK


def test_an_end_that_the_disk_takes_too_slowly_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(background_file, "_MOST_POLLS", 4)
    monkeypatch.setattr(background_file, "_LEAST_POLLS", 4)
    released, put = threading.Event(), BackgroundFile._put

    def slowly(self: BackgroundFile, data: bytes) -> bool:
        released.wait(0.02)
        return put(self, data)

    monkeypatch.setattr(BackgroundFile, "_put", slowly)
    file = BackgroundFile(tmp_path / "file", waits=False)
    monkeypatch.setattr(file, "_patience", DiskPatience())
    write(file, 500)
    with pytest.raises(TimeoutError, match=r"the disk takes too little, 0\.[1-5] MB are lost"):
        file.close()
    assert file._thread.is_alive()
    released.set()
    file._thread.join()
    assert (tmp_path / "file").read_bytes() == 500 * BLOCK


def test_a_write_after_the_end_is_refused(tmp_path: Path) -> None:
    file = BackgroundFile(tmp_path / "file")
    file.write(BLOCK)
    file.close()
    with pytest.raises(ValueError, match="file is closed"):
        file.write(BLOCK)
    assert (tmp_path / "file").read_bytes() == BLOCK
