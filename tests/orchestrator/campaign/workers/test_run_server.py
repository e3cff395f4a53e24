"""The run server: what it imports, and what it leaves when its program is killed."""

import os
import pickle
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.wil_campaign.test_installed_plugins import put_distribution
from wil_campaign.campaigns.expansion.expansion import load_campaign

_PROGRAM = """
import sys, time
from wil_campaign.orchestrator.campaign.workers.run_server import start_run_server
start_run_server()
print("started", flush=True)
time.sleep(600)
"""
_RUN = """
import os, signal
from concurrent.futures import ProcessPoolExecutor
from wil_campaign.foundation.processes.parallel_calls import end_with_program
from wil_campaign.orchestrator.campaign.workers.run_server import (
    run_context, run_environment, running_context, start_run_server
)
if __name__ == "__main__":
    assert running_context() is None
    start_run_server()
    context = running_context()
    for number in (signal.SIGTERM, signal.SIGHUP):
        with ProcessPoolExecutor(1, mp_context=context, initializer=end_with_program) as pool:
            print(type(pool.submit(signal.raise_signal, number).exception()).__name__)
    print(run_environment() == dict(os.environ), "PYTHONSAFEPATH" in os.environ, flush=True)
    run = run_context().Process(target=os.mkdir, args=("flown",))
    run.start()
    run.join()
"""
_POOL = """
import multiprocessing, os, sys, time
from concurrent.futures import ProcessPoolExecutor
from wil_campaign.foundation.processes.parallel_calls import end_with_program
from wil_campaign.orchestrator.campaign.workers.run_server import running_context, start_run_server
if __name__ == "__main__":
    if sys.argv[1] == "beside the run server":
        start_run_server()
    context = running_context() or multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(1, mp_context=context, initializer=end_with_program)
    print(pool.submit(os.getpid).result(), flush=True)
    time.sleep(600)
"""
_LOST = """
import os, shutil
from multiprocessing import forkserver, util
from wil_campaign.orchestrator.campaign.workers.run_server import running_context, start_run_server
if __name__ == "__main__":
    start_run_server()
    for name in ("first", "second", "third", "fourth"):
        run = running_context().Process(target=os.mkdir, args=(name,))
        run.start()
        run.join()
        folder = util.get_temp_dir()
        if name == "first":
            shutil.rmtree(folder)
        elif name == "second":
            shutil.rmtree(os.path.dirname(folder))
        elif name == "third":
            os.unlink(forkserver._forkserver._forkserver_address)
"""
_READ = """
import pickle
import sys
from pathlib import Path
from pydantic import BaseModel
from wil_campaign.orchestrator.campaign.workers import run_server_imports

def refuse(model, **_):
    raise AssertionError(model)

there = set(sys.modules)
BaseModel.model_rebuild = classmethod(refuse)
pickle.loads(Path(sys.argv[1]).read_bytes()).setup()
print([name for name in set(sys.modules) - there if name.startswith("wil_campaign.")])
"""
_IMPORTING = """
import os, signal, sys
from wil_campaign.orchestrator.campaign.workers import run_server
if __name__ == "__main__":
    run_server._PRELOADED = sys.argv[1]
    run_server.start_run_server()
    if sys.argv[1] == "interrupted":
        run = run_server.run_context().Process(target=signal.raise_signal, args=(signal.SIGINT,))
        run.start()
        run.join()
"""
_BROKEN = """
from wil_campaign.hooks import implements

@implements
def recipe_steps():
    raise ValueError("broken")
"""
_ROOT = Path(__file__).parents[4]
_WITHIN_S = 120.0


def test_a_program_that_is_killed_leaves_no_socket_of_its_run_server(
    tmp_path: Path, short_folder: Path
) -> None:
    """Nor does it need a short TMPDIR: the paths of sockets have 107 bytes."""
    environment = {**os.environ, "PYTHONPATH": str(_ROOT), "XDG_RUNTIME_DIR": str(short_folder)}
    environment["TMPDIR"] = str(tmp_path / ("x" * 100))
    Path(environment["TMPDIR"]).mkdir()
    runtime = short_folder / "wil-campaign"
    with subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, "-c", _PROGRAM], env=environment, cwd=_ROOT, stdout=subprocess.PIPE
    ) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == b"started\n"
        assert [path.is_socket() for path in runtime.glob("pymp-*/*")] == [True]
        program.kill()
    end_s = time.monotonic() + _WITHIN_S  # it imports what runs need before it sees its end
    while any(runtime.glob("pymp-*")) and time.monotonic() < end_s:
        time.sleep(0.05)
    assert [*runtime.iterdir(), *Path(environment["TMPDIR"]).iterdir()] == []


@pytest.mark.parametrize("where", ["beside the run server", "alone"])
def test_a_program_that_is_killed_leaves_no_worker_of_its_report(
    tmp_path: Path, where: str
) -> None:
    program = tmp_path / "program.py"
    program.write_text(_POOL)
    with subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, program, where],
        env={**os.environ, "PYTHONPATH": str(_ROOT)},
        stdout=subprocess.PIPE,
    ) as ended:
        assert ended.stdout is not None
        worker = Path("/proc", ended.stdout.readline().decode().strip())
        assert worker.is_dir()
        ended.kill()
    end_s = time.monotonic() + _WITHIN_S
    while worker.is_dir() and time.monotonic() < end_s:
        time.sleep(0.05)
    assert not worker.is_dir()


def test_runs_are_flown_after_the_folder_of_the_run_servers_socket_has_gone(
    tmp_path: Path, short_folder: Path
) -> None:
    program = tmp_path / "program.py"
    program.write_text(_LOST)
    environment = {**os.environ, "PYTHONPATH": str(_ROOT), "XDG_RUNTIME_DIR": str(short_folder)}
    ended = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, program], env=environment, cwd=tmp_path, check=False, capture_output=True
    )
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert all((tmp_path / name).is_dir() for name in ("first", "second", "third", "fourth"))


def _end_of_program(tmp_path: Path, imports: str, preloaded: str) -> tuple[int, str]:
    """Return the exit code and the output of a program whose run server imports `imports`.

    It ends once no process has its output open.
    """
    program = tmp_path / "program.py"
    program.write_text(_IMPORTING)
    (tmp_path / f"{preloaded}.py").write_text(imports)
    ended = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, program, preloaded],
        env={**os.environ, "PYTHONPATH": f"{_ROOT}:{tmp_path}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=_WITHIN_S,
        check=False,
    )
    return ended.returncode, ended.stdout


def test_what_reads_the_output_of_a_program_does_not_wait_for_imports_of_its_run_server(
    tmp_path: Path,
) -> None:
    """`wil-campaign run absent.yaml | less`: it has said all that there is."""
    imports = f"import time\ntime.sleep({2 * _WITHIN_S})"
    assert _end_of_program(tmp_path, imports, "importing") == (0, "")


def test_ctrl_c_while_the_run_server_imports_prints_no_traceback(tmp_path: Path) -> None:
    """Nor do runs, which the campaign's process ends."""
    imports = """
import os, signal
os.kill(os.getpid(), signal.SIGINT)
from wil_campaign.orchestrator.campaign.workers import run_server_imports
print("imported", flush=True)
"""
    assert _end_of_program(tmp_path, imports, "interrupted") == (0, "imported\n")


def test_a_file_of_the_user_is_not_imported_in_place_of_a_module(tmp_path: Path) -> None:
    """As when a person changes into a folder with an autonomy `random.py`, and flies there."""
    here, program = tmp_path / "here", tmp_path / "bin" / "program"
    for folder in (here, program.parent):
        folder.mkdir()
    program.write_text(_RUN)  # as the console script: its folder is not the current one
    for name in ("random", "tempfile", "numpy"):
        (here / f"{name}.py").write_text(f"open('imported {name}', 'w')\n")
    ended = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, program],
        env={**os.environ, "PYTHONPATH": str(_ROOT)},
        cwd=here,
        capture_output=True,
        text=True,
        timeout=_WITHIN_S,
        check=False,
    )
    assert ended.stdout == "BrokenProcessPool\nBrokenProcessPool\nTrue False\n", ended.stderr
    assert (here / "flown").is_dir(), ended.stderr
    assert list(here.glob("imported *")) == []


def test_a_run_loads_nothing_to_read_its_files_that_the_run_server_can_load(tmp_path: Path) -> None:
    """What `validate` warns of, its campaign has read already."""
    plan = tmp_path / "plan"
    plan.write_bytes(pickle.dumps(load_campaign(_ROOT / "campaigns" / "gate.yaml").runs[0]))
    ended = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", _READ, plan],
        env={**os.environ, "PYTHONPATH": str(_ROOT)},
        capture_output=True,
        text=True,
        timeout=_WITHIN_S,
        check=False,
    )
    assert ended.stdout == "[]\n", ended.stderr


def test_a_plugin_that_cannot_be_used_does_not_end_the_run_server(tmp_path: Path) -> None:
    """The runs that use it say what is wrong."""
    put_distribution(tmp_path, "broken", "broken", {"broken.py": _BROKEN})
    program = tmp_path / "program"
    program.write_text(_RUN)
    ended = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, program],
        env={**os.environ, "PYTHONPATH": f"{_ROOT}:{tmp_path}"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=_WITHIN_S,
        check=False,
    )
    assert (tmp_path / "flown").is_dir(), ended.stderr
    assert ended.stderr == ""
