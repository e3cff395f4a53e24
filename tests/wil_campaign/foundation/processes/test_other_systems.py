"""Elsewhere than on Linux: what flies in virtual time flies, and the rest is refused in words.

A Mac is not at hand: a `sitecustomize` takes away what Linux alone has.
"""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.orchestrator.hover import write_hover
from tests.test_house import ROOT, sources

MAC = """\
import asyncio, ctypes, logging, multiprocessing.forkserver, multiprocessing.util, os, pathlib
import select, socket, sys, sysconfig, tempfile

import numba, psutil

sysconfig.get_config_vars()
sys.platform = "darwin"
for module, names in (
    (os, "sched_getaffinity sched_setaffinity sched_setscheduler sched_param SCHED_RR SCHED_OTHER"
         " SCHED_RESET_ON_FORK pidfd_open memfd_create eventfd"),
    (select, "epoll"),
    (socket, "SO_PEERCRED"),
):
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)


def refuse(event, args):
    if event not in ("open", "os.listdir", "os.scandir", "os.readlink"):
        return
    if not isinstance(args[0], str) or not args[0].startswith("/proc/"):
        return
    frame = sys._getframe(1)
    while frame is not None:
        if "site-packages" in frame.f_code.co_filename:
            return
        frame = frame.f_back
    raise FileNotFoundError(2, "no such file on this system", args[0])


sys.addaudithook(refuse)
"""
LINUX_ALONE = {
    "sched_getaffinity",
    "sched_setaffinity",
    "sched_setscheduler",
    "pidfd_open",
    "mlockall",
    "prctl",
    "SO_PEERCRED",
    "PR_SET_PDEATHSIG",
    "epoll",
    "eventfd",
    "memfd_create",
}
MAY_USE_THEM = {
    "wil_campaign/foundation/processes/linux.py": LINUX_ALONE,
    # Ray has wheels for Linux alone, and an agent of it imports nothing of ours.
    "plugins/cluster/node_agent.py": {"pidfd_open"},
}


def on_a_mac(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    (folder / "sitecustomize.py").write_text(MAC)
    paths = os.pathsep.join([str(folder), str(ROOT)])
    return subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-m", "wil_campaign", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": paths, "WIL_DEBUG": "1", "XDG_STATE_HOME": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_doctor_looks_at_other_systems_too(tmp_path: Path) -> None:
    done = on_a_mac(tmp_path, "doctor")
    assert "Traceback" not in done.stderr, done.stderr
    assert "use Linux: only there" in done.stdout


@pytest.mark.parametrize(
    ("clock", "code", "said"),
    [("virtual", 0, "PASS"), ("wall", 3, "only Linux runs vehicles in processes of their own")],
)
def test_runs_on_other_systems_fly_in_virtual_time_alone(
    tmp_path: Path, clock: str, code: int, said: str
) -> None:
    path = write_hover(tmp_path)
    words = ("--repetitions", "1", "--out", str(tmp_path / "out"), "--clock", clock)
    done = on_a_mac(tmp_path, "run", str(path), *words)
    assert "Traceback" not in done.stderr, done.stderr
    assert done.returncode == code, done.stdout + done.stderr
    assert said in done.stdout + done.stderr


def test_functions_of_linux_alone_are_used_in_one_module() -> None:
    found = {}
    for path in sources():
        place = str(path.relative_to(ROOT))
        if not any(name in (source := path.read_text()) for name in LINUX_ALONE):
            continue
        tree = ast.parse(source)
        named = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        if used := named & LINUX_ALONE - MAY_USE_THEM.get(place, set()):
            found[place] = used
    assert found == {}
