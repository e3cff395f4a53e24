"""For all tests: properties are searched without a deadline, for these machines are shared."""

import os

# Their threads wait for work by asking for it again and again: with them each of the workers, and
# each program that a test starts, takes what others need.
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import fcntl
import gc
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from functools import cache
from pathlib import Path
from typing import IO

import pytest
from hypothesis import settings

from tests.in_turn import SHARES, flies_in_turn, share_of_commit
from tests.ports import free_port
from wil_campaign.foundation.processes.linux import die_with_parent

settings.register_profile("here", deadline=None)
# CI searches the same way each time: more examples find nothing that the first run did not.
settings.register_profile("ci", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("ci" if os.environ.get("CI") else "here")


pytest_plugins = ["pytester"]

gc.disable()  # until all tests are collected

ROOT = Path(__file__).parent
FAST = (
    "campaigns/values",
    "orchestrator/cli/test_arming_consent.py",
    "orchestrator/cli/test_external_lines.py",
    "orchestrator/run_results",
    "orchestrator/report/reading/test_report_reading.py",
    "orchestrator/report/rendering/test_report_page.py",
    "orchestrator/report/test_report_words.py",
    "orchestrator/state",
    "plugins/meshes",
    "plugins/steps",
    "plugins/injection/test_injected_messages.py",
    "plugins/injection/test_injection_check.py",
    "plugins/injection/test_injection_support.py",
    "plugins/injection/test_injector.py",
    "plugins/outlets/test_camera_component.py",
    "plugins/outlets/test_contact_messages.py",
    "plugins/outlets/test_rtp_delivery.py",
    "plugins/outlets/test_zmq_delivery.py",
    "plugins/standalone/test_vehicle_camera.py",
    "recipes",
    "safety/evaluation",
    "safety/evidence",
    "safety/fence",
    "safety/guard/core",
    "safety/model",
    "safety/oracles",
    "plugins/stl/test_stl_formula.py",
    "test_docs.py",
    "test_order.py",
    "vehicles/autopilots",
    "vehicles/clocks",
    "vehicles/driver/session",
    "vehicles/mavlink",
    "vehicles/perception",
    "vehicles/poses",
    "vehicles/readings",
    "vehicles/sensors",
    "vehicles/test_faults.py",
    "vehicles/test_telemetry_fit.py",
    "wil_campaign/foundation/files",
    "worlds/rays",
    "worlds/render",
    "worlds/scene",
    "worlds/test_frames.py",
    "worlds/test_geodesy.py",
    "worlds/world_file",
)
"""What flies no run, starts no process and searches not for long; everything else is slow."""

FLIGHTS = (
    "faults/test_clock_steps.py",
    "faults/test_socket_flights.py",
    "plugins/python/test_flown_places.py",
    "orchestrator/campaign/test_attached_run.py",
    "plugins/console/test_console_flight.py",
    "plugins/cluster/bench/test_bench_deaths.py",
    "plugins/cluster/bench/test_bench_flight.py",
    "orchestrator/external/test_attached_readings.py",
    "orchestrator/external/test_external_flights.py",
    "orchestrator/recording/test_wall_recording.py",
    "orchestrator/run/flight/test_actor_links.py",
    "orchestrator/run/flight/test_lockstep_run.py",
    "plugins/mavsdk/test_mavsdk_run.py",
    "plugins/programs/test_program_flights.py",
    "plugins/ros2/test_node_wall_flight.py",
    "plugins/search/test_search_on_bench.py",
    "orchestrator/run/flight/test_scaled_run.py",
    "orchestrator/run/flight/test_wall_run.py",
    "vehicles/clients",
)
"""What flies on the wall clock: vehicles, guard and orchestrator are processes that must all be in
time. As many such flights are in the air as there are TURNS. A test among them that is marked
`no_turn`, with the reason, needs no turn: time waits for whoever is late (docs/decisions/0028), or
nothing flies. One that has its turn by the fixture `turn` gives it back itself, once what it waits
for is no matter of the processor."""

QUEUE = Path(__file__)
TURNS = (ROOT / "kernels.py", ROOT / "test_order.py")
"""The files of which a flight on the wall clock locks one: two are in the air at most.

Each takes an eighth of a core. Who comes first has the next turn: the others wait for QUEUE.
"""
TURN_POLL_S = 0.1

CORES_QUEUE = ROOT / "test_docs.py"
CORES = sorted(ROOT.glob("*/**/*.py"))[: (os.cpu_count() or 1) + 1]
"""The files of which a worker locks one to compute: one more than there are cores do so at once.

Five at once on two cores, who put each other out of the caches, took a third more of the
processor for the same tests than two. A worker keeps its core as long as its tests compute. They
wait for CORES_QUEUE.
"""

WALL = (
    "orchestrator/campaign/resuming/test_runs_to_fly.py",
    "orchestrator/cli/commands/test_operate_commands.py",
    "orchestrator/cli/commands/test_run_command.py",
    "orchestrator/cli/test_arming_consent.py",
    "plugins/standalone/test_vehicle_camera.py",
    "plugins/cluster/test_ray_engine.py",
    "plugins/depth_cameras/test_depth_cameras.py",
    "plugins/cluster/test_store_of_results.py",
    "orchestrator/operator",
    "plugins/mqtt",
    "plugins/search/test_search_flown.py",
    "plugins/search/test_search_places.py",
    "safety/guard/process",
    "vehicles/driver/test_conformance.py",
    "vehicles/embedded/process",
    "plugins/firmware",
    "plugins/stream_links/test_flapping.py",
    "plugins/mavsdk",
    "wil_campaign/foundation/processes/test_other_systems.py",
    "plugins/readings/test_zmq_readings.py",
    "plugins/cameras/test_streams.py",
)
"""What waits on the wall clock: it leaves the processor idle most of the time."""


MOST_WAITING = 2
"""How many workers begin with what waits."""
YIELDING = 5
"""What workers add to their niceness once they are at tests that wait for nothing."""
YIELDING_SESSION = 5
"""The niceness of the workers' session: programs that fly, in others, have three times its share.

So has whatever else is busy on the machine: with 10 it left a tenth, and tests ran out of time."""
_WEIGHED = pytest.StashKey[int]()
_SHARE = pytest.StashKey[int | None]()


@pytest.hookimpl(optionalhook=True)  # of pytest-xdist
def pytest_xdist_auto_num_workers() -> int | None:
    """Have three workers more than there are cores: many tests wait for a clock or a process.

    As many as cores leave two cores idle most of the time; each one more collects all tests, for
    14 s of CPU. None: a variable says how many.
    """
    if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None
    return (os.cpu_count() or 1) + 3


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add what flies all of tests/in_turn.py."""
    parser.addoption("--all", action="store_true", help="fly all that flies in turn, too")


def pytest_configure(config: pytest.Config) -> None:
    """End a worker of pytest-xdist with pytest itself: else it would fly on for minutes.

    Who names a test has it flown. A shell that starts pytest in the background has it, and all its
    children, ignore Ctrl-C, which is what some tests send.
    """
    if hasattr(config, "workerinput") and sys.platform == "linux":
        die_with_parent(signal.SIGTERM)
    named = config.args_source is not pytest.Config.ArgsSource.TESTPATHS
    named = named or bool(config.option.keyword) or getattr(config.option, "lf", False)
    config.stash[_SHARE] = None if named or config.option.all else share_of_commit(ROOT)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_report_header(config: pytest.Config) -> str:
    """Say what is left out: workers of pytest-xdist do not count it."""
    if (share := config.stash[_SHARE]) is None:
        return ""
    of = f"share {share + 1} of {SHARES}, by the commit"
    return f"in turn: of tests/in_turn.py {of}; the others are left out, --all flies all"


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile the control laws before workers of pytest-xdist start, where they are not kept yet.

    Otherwise each worker compiles them, and the tests that wait on the wall clock, which are the
    first, see vehicles that take half a minute until their first word.
    """
    if getattr(session.config.option, "numprocesses", None):
        from wil_campaign.vehicles.embedded.emulations import load_kernels

        load_kernels()
        gc.enable()  # the workers collect the tests
        _weigh_session(session.config, YIELDING_SESSION)


def pytest_unconfigure(config: pytest.Config) -> None:
    """Weigh the session as it was: it is that of somebody's terminal; leave the core to others."""
    _leave_core()  # a worker's process lives until all have ended
    if (before := config.stash.get(_WEIGHED, None)) is not None:
        _weigh_session(config, before)


def _weigh_session(config: pytest.Config, nice: int) -> None:
    """Weigh all processes of this session together (autogroup), where Linux does so.

    The niceness of a process counts among those of its session alone. Programs that fly on the wall
    clock have sessions of their own: the workers' would take as much as all that one flight needs.
    """
    group = Path("/proc/self/autogroup")
    with suppress(OSError, ValueError):
        before = int(group.read_text("utf-8").rpartition(" ")[2])
        group.write_text(str(nice), "utf-8")
        config.stash.setdefault(_WEIGHED, before)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out whose turn it is not; mark what is not of the fast tier; order the workers' work.

    `pytest -m "not slow"` leaves out what is not of the fast tier. Of the workers of pytest-xdist
    two begin with the flights on the wall clock, one if there are few workers, two others with what
    else waits on it and then with the flights that need no turn: they are long. Further ones begin
    with what waits for nothing, which fills the processor that the others leave idle.
    """
    if (share := config.stash[_SHARE]) is not None:
        in_turn = sorted(filter(_flies_in_turn, items), key=lambda item: item.nodeid)
        left_out = set(in_turn).difference(in_turn[share::SHARES])
        items[:] = [item for item in items if item not in left_out]
        config.hook.pytest_deselected(items=[item for item in in_turn if item in left_out])
    flights: list[pytest.Item] = []
    waiting: list[pytest.Item] = []
    long: list[pytest.Item] = []
    others: list[pytest.Item] = []
    for item in items:
        path = _place(item.path)
        if not _is_among(path, FAST):
            item.add_marker(pytest.mark.slow)
        if _is_among(path, FLIGHTS):
            if _takes_own_turn(item):
                waiting.insert(0, item)
            else:
                (flights if _needs_turn(item) else long).append(item)
        else:
            (waiting if _is_among(path, WALL) else others).append(item)
    if (workers := _workers()) > 1:
        flies = len(TURNS) if workers >= len(TURNS) + MOST_WAITING else 1
        waits = min(workers - flies, MOST_WAITING)
        begun = [flights[k::flies] for k in range(flies)]
        begun += [waiting[k::waits] + long[k::waits] for k in range(waits)]
        begun += [[] for _ in range(workers - len(begun))]
        items[:] = _shares(begun, others)


def pytest_collection_finish(session: pytest.Session) -> None:
    """Have the collector of garbage look no more at what stays until the end: all tests, all code.

    With thousands of tests it took a twentieth of their time. It looked at nothing while they were
    collected: that took a sixth of it.
    """
    gc.freeze()
    gc.enable()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Have few flights on the wall clock in the air, and all that waits for nothing yield.

    A flight waits for its turn, and what computes for a core, before its time counts. The kernel
    serves whoever is nicer last, so that searches and flights in virtual time fill what flights on
    the wall clock leave idle.
    """
    path = _place(item.path)
    flies = _is_among(path, FLIGHTS) and _needs_turn(item)
    if _workers() > 1:
        if not (flies or _is_among(path, WALL) or _takes_own_turn(item)):
            os.nice(max(0, YIELDING - os.nice(0)))
        computes = not _is_among(path, FLIGHTS + WALL)
        _take_core() if computes else _leave_core()
        if hasattr(os, "SCHED_BATCH"):  # Linux: switched less often, they take a tenth less time
            policy = os.SCHED_BATCH if computes else os.SCHED_OTHER
            with suppress(OSError):  # where a container forbids it
                os.sched_setscheduler(0, policy, os.sched_param(0))
    with _in_turn() if flies and not _takes_own_turn(item) else nullcontext():
        return (yield)


@contextmanager
def _in_turn() -> Iterator[Callable[[], None]]:
    """Wait for the turn of a flight on the wall clock; gives what gives it back sooner."""
    with _first_free(TURNS, QUEUE) as turn:

        def give_back() -> None:
            # What was forked meanwhile and lives on has this file open, too.
            fcntl.flock(turn, fcntl.LOCK_UN)

        try:
            yield give_back
        finally:
            give_back()


_core: list[IO[str]] = []
"""The open file of the core that this worker has."""


def _take_core() -> None:
    """Wait for a core, unless this worker has one."""
    if not _core:
        _core.append(_first_free(CORES, CORES_QUEUE))


def _leave_core() -> None:
    """Give back the core of this worker, if it has one."""
    while _core:
        with _core.pop() as core:
            fcntl.flock(core, fcntl.LOCK_UN)


def _first_free(paths: Sequence[Path], queue: Path) -> IO[str]:
    """Wait until nobody else has locked one of the files, and return it locked.

    Who comes first has the next: the others wait for the queue.
    """
    with ExitStack() as opened, queue.open(encoding="utf-8") as before:
        files = [opened.enter_context(path.open(encoding="utf-8")) for path in paths]
        fcntl.flock(before, fcntl.LOCK_EX)
        while (free := next(filter(_locks, files), None)) is None:
            time.sleep(TURN_POLL_S)
        # Its lock stays with the file's copy when the others are closed.
        return os.fdopen(os.dup(free.fileno()), encoding="utf-8")


def _locks(file: IO[str]) -> bool:
    """Lock an open file; return whether nobody else has it."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


@pytest.fixture
def turn() -> Iterator[Callable[[], None]]:
    """The turn of a flight on the wall clock; call it to give it back before the test's end."""
    with _in_turn() as give_back:
        yield give_back


def _workers() -> int:
    return int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))


def _flies_in_turn(item: pytest.Item) -> bool:
    return flies_in_turn(_place(item.path).as_posix(), item.name)


def _needs_turn(item: pytest.Item) -> bool:
    return item.get_closest_marker("no_turn") is None


def _takes_own_turn(item: pytest.Item) -> bool:
    return "turn" in getattr(item, "fixturenames", ())


@cache
def _place(path: Path) -> Path:
    """Return a file's place beneath tests, or its path where it stands elsewhere."""
    return path.relative_to(ROOT) if path.is_relative_to(ROOT) else path


@cache
def _is_among(path: Path, places: tuple[str, ...]) -> bool:
    return not {path.as_posix(), *(parent.as_posix() for parent in path.parents)}.isdisjoint(places)


def _shares(begun: list[list[pytest.Item]], then: list[pytest.Item]) -> Iterator[pytest.Item]:
    """Yield equal shares of tests, one behind the other: `--dist worksteal` hands them out so.

    begun: what each worker begins with.
    """
    total, workers = sum(map(len, begun)) + len(then), len(begun)
    for k, mine in enumerate(begun):
        yield from mine
        size = max(0, total * (k + 1) // workers - total * k // workers - len(mine))
        yield from then[:size]
        then = then[size:]
    yield from then


@pytest.fixture
def unused_tcp_port() -> int:
    """A port that nobody else gets; that of pytest-asyncio, whose name it has, may be taken."""
    return free_port()


@pytest.fixture
def short_folder() -> Iterator[Path]:
    """A folder for sockets: beneath pytest's own their paths are too long."""
    folder = Path(tempfile.mkdtemp(prefix="wil-"))
    yield folder
    shutil.rmtree(folder)
