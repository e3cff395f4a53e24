"""A crash-safe file is written whole, or not at all."""

import errno
import json
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from wil_campaign.vehicles.driver.onboard.crash_safe_file import CrashSafeFile

SUFFIX = ".test.json"


def open_handles() -> int:
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


def test_a_failed_write_leaves_nothing_and_may_be_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    before = open_handles()
    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space left"):
            CrashSafeFile.write(tmp_path, SUFFIX, {"a": 1})
    assert list(tmp_path.iterdir()) == []
    assert open_handles() == before
    CrashSafeFile.write(tmp_path, SUFFIX, {"a": 1}).close()
    assert [path.name for path in tmp_path.iterdir()] == [f"000001{SUFFIX}"]


def test_a_write_that_the_system_cuts_short_is_completed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = os.write
    with monkeypatch.context() as patched:
        patched.setattr(os, "write", lambda handle, data: write(handle, bytes(data)[:3]))
        CrashSafeFile.write(tmp_path, SUFFIX, {"a": "b" * 100}).close()
    (path,) = tmp_path.iterdir()
    assert json.loads(path.read_text()) == {"a": "b" * 100}


def test_two_threads_write_at_the_same_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    both = threading.Barrier(2)

    def sync(_handle: int) -> None:
        both.wait(10.0)

    monkeypatch.setattr(os, "fsync", sync)
    with ThreadPoolExecutor(2) as threads:
        writing = [threads.submit(CrashSafeFile.write, tmp_path, SUFFIX, {"a": k}) for k in (1, 2)]
        files = [each.result() for each in writing]
    assert [json.loads(file.path.read_text()) for file in files] == [{"a": 1}, {"a": 2}]
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"000001{SUFFIX}", f"000002{SUFFIX}"]
    for file in files:
        file.close()


def test_a_file_removed_twice_leaves_another_that_has_its_number_by_now(tmp_path: Path) -> None:
    file = CrashSafeFile.write(tmp_path, SUFFIX, {"a": 1})
    file.remove()
    file.close()
    other = CrashSafeFile.write(tmp_path, SUFFIX, {"a": 2})
    assert other.path == file.path
    file.remove()
    assert json.loads(other.path.read_text()) == {"a": 2}
    other.close()
