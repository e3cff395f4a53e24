"""What a run prints and leaves behind."""

import errno
import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from wil_campaign.foundation.processes import limited_log
from wil_campaign.orchestrator.campaign.workers.run_output import (
    OUTPUT_FILE,
    redirected_run_output,
    run_output_tail,
)


def test_the_output_of_a_run_goes_to_its_file(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with redirected_run_output(tmp_path):
        os.write(1, b"of a library\n")
        subprocess.run([sys.executable, "-c", "print('of a child')"], check=True)
    os.write(1, b"afterwards\n")
    assert (tmp_path / OUTPUT_FILE).read_text() == "of a library\nof a child\n"
    assert run_output_tail(tmp_path, 1) == ["of a child"]
    assert capfd.readouterr().out == "afterwards\n"


def test_a_silent_run_has_no_file(tmp_path: Path) -> None:
    with redirected_run_output(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []
    assert run_output_tail(tmp_path, 3) == []


def test_a_run_that_prints_without_end_fills_no_disk_and_its_last_lines_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, size in (("MOST", 1000), ("HEAD", 300), ("TAIL", 200)):
        monkeypatch.setattr(limited_log, f"_{name}_BYTES", size)
    with redirected_run_output(tmp_path):
        for number in range(100):
            os.write(1, f"{number:99d}\n".encode())
    lines = (tmp_path / OUTPUT_FILE).read_text().splitlines()
    assert [line.strip() for line in lines] == [
        *("0", "1", "2", "", "[9500 bytes are left out here]"),
        *("98", "99"),
    ]
    assert run_output_tail(tmp_path, 1) == [f"{99:99d}"]


def test_a_full_disk_loses_the_output_and_not_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    class FullDisk(io.StringIO):
        def flush(self) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

    with redirected_run_output(tmp_path):
        monkeypatch.setattr(sys, "stdout", FullDisk())
    os.write(1, b"afterwards\n")
    assert capfd.readouterr().out == "afterwards\n"
