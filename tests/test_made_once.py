"""What is made once for all workers: by one of them, whole, and again where it failed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.made_once import made_once
from tests.test_house import ROOT

MAKES = """\
import sys, time
from pathlib import Path
from tests.made_once import made_once

class Factory:
    def getbasetemp(self):
        return own

own, makers, workers = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])

def make(folder):
    while len(list(own.parent.glob("popen-*/asks"))) < workers:
        time.sleep(0.01)
    time.sleep(0.1)  # by now the others would make it, too
    with open(makers, "a") as file:
        file.write("made ")
    (folder / "last").touch()

(own / "asks").touch()
assert (made_once(Factory(), "flown", make) / "last").exists()
"""


def test_workers_that_ask_at_once_have_what_one_of_them_made(tmp_path: Path) -> None:
    makers = tmp_path / "makers"
    names, workers = ("gw0", "gw1", "gw2"), []
    for name in names:
        own = tmp_path / f"popen-{name}"
        own.mkdir()
        command = [sys.executable, "-c", MAKES, str(own), str(makers), str(len(names))]
        given = {**os.environ, "PYTEST_XDIST_WORKER": name}
        workers.append(subprocess.Popen(command, cwd=ROOT, env=given))  # noqa: S603 - our own
    assert [one.wait() for one in workers] == [0, 0, 0]
    assert makers.read_text() == "made "


def test_what_could_not_be_made_is_made_anew(tmp_path_factory: pytest.TempPathFactory) -> None:
    def fail(folder: Path) -> None:
        (folder / "half").touch()
        raise RuntimeError

    name = f"failed-{os.getpid()}"
    with pytest.raises(RuntimeError):
        made_once(tmp_path_factory, name, fail)
    folder = made_once(tmp_path_factory, name, lambda folder: (folder / "whole").touch())
    assert [path.name for path in folder.iterdir()] == ["whole"]
    assert made_once(tmp_path_factory, name, fail) == folder
