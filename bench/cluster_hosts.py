"""Two machines on one: network namespaces with addresses, names and a /tmp of their own.

They share processors, disk and clock, and nothing else that Ray or this program could meet in: no
loopback, no sockets, no /tmp. It needs root, `ip` and `unshare`.
"""

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import psutil

PORT = 6379
STORE_PORT = 9000
TOKEN = "bench-of-two-hosts-0123456789abcdef"  # noqa: S105  # of a cluster that nobody else reaches
_OBJECTS = "--object-store-memory=80000000"
JOINED_S = 120.0
STARTED_S = 300.0


@dataclass
class Host:
    """A machine of its own, as far as processes in it can tell. holder: keeps its namespaces."""

    name: str
    address: str
    holder: subprocess.Popen[bytes]
    logs: Path
    environment: Mapping[str, str] = field(default_factory=dict)

    @property
    def namespace(self) -> str:
        return f"wil-{self.name}"

    def command(self, *words: str) -> list[str]:
        """Return a command line that does a command on this host."""
        return ["nsenter", "-t", str(self.holder.pid), "-n", "-m", "-u", "--", *words]

    def start(self, log: str, *words: str, **more: str) -> subprocess.Popen[bytes]:
        """Start a program on this host. log: the file for what it prints. more: environment."""
        with (self.logs / f"{self.name}-{log}.log").open("ab") as output:
            return subprocess.Popen(  # noqa: S603 - our own programs
                self.command(*words),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=self.environment_of_programs(**more),
                start_new_session=True,
            )

    def run(
        self, *words: str, timeout_s: float = 600, **more: str
    ) -> "subprocess.CompletedProcess[str]":
        """Run a program on this host to its end."""
        return subprocess.run(  # noqa: S603 - our own programs
            self.command(*words),
            check=False,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            env=self.environment_of_programs(**more),
        )

    def program(self, *words: str) -> list[str]:
        """Return the command line of our own program."""
        return [sys.executable, "-m", "wil_campaign", *words]

    def processes(self) -> list[psutil.Process]:
        """Return what runs on this host, without what keeps it."""
        return [
            process for process in _processes_in(self.namespace) if process.pid != self.holder.pid
        ]

    def find(self, text: str) -> psutil.Process | None:
        """Return a process of this host by its command line; the oldest."""
        found = [process for process in self.processes() if text in _line(process)]
        return min(found, key=lambda one: one.create_time(), default=None)

    def flying(self) -> list[psutil.Process]:
        """Return what flies on this host or would: none of Ray, of a store, of a bench's server."""
        ours = ("wil_campaign", "multiprocessing.forkserver")
        others = ("ray::", "bench serve", "bench_node", "ray start")
        return [
            process
            for process in self.processes()
            if any(word in _line(process) for word in ours)
            and not any(word in _line(process) for word in others)
        ]

    def flying_runs(self) -> list[psutil.Process]:
        """Return the processes that fly a run on this host: what a run server has forked."""
        servers = [
            process
            for process in self.processes()
            if "multiprocessing.forkserver" in _line(process)
        ]
        pids = {server.pid for server in servers}
        return [server for server in servers if server.ppid() in pids]

    def end(self) -> None:
        """End every process of this host."""
        for _ in range(20):
            every = self.processes()
            if not every:
                return
            for process in every:
                with contextlib.suppress(psutil.Error):
                    process.kill()
            time.sleep(0.2)

    def environment_of_programs(self, **more: str) -> dict[str, str]:
        """Return the environment of a program on this host."""
        kept = {name: text for name, text in os.environ.items() if not name.startswith("RAY_")}
        token = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": TOKEN, "RAY_worker_niceness": "0"}
        return {**kept, **token, **_store_access(), **self.environment, **more}


@contextmanager
def two_hosts(logs: Path) -> Iterator[tuple[Host, Host]]:
    """Have two hosts that reach each other."""
    with ExitStack() as stack:
        hosts = [
            stack.enter_context(_host(name, f"10.77.0.{number}", logs))
            for number, name in enumerate(("first", "second"), start=1)
        ]
        ends = [("wilveth1", hosts[0]), ("wilveth2", hosts[1])]
        _ip("link", "add", ends[0][0], "type", "veth", "peer", "name", ends[1][0])
        for device, host in ends:
            _ip("link", "set", device, "netns", host.namespace)
            _ip("-n", host.namespace, "addr", "add", f"{host.address}/24", "dev", device)
            _ip("-n", host.namespace, "link", "set", "lo", "up")
            _ip("-n", host.namespace, "link", "set", device, "up")
        yield hosts[0], hosts[1]


@contextmanager
def cluster_of(first: Host, second: Host, places: Sequence[int] = (1, 1)) -> Iterator[str]:
    """Have a Ray cluster over both hosts, by the commands of docs/cluster.md; give its address."""
    address = f"{first.address}:{PORT}"
    start_head(first, places[0])
    start_node(second, address, places[1])
    try:
        yield address
    finally:
        second.end()
        first.end()


def start_head(host: Host, places: int, *more: str) -> "subprocess.Popen[bytes]":
    """Start the head of a cluster, and wait until it is up. more: options of Ray."""
    head = ("--head", f"--port={PORT}", "--include-dashboard=false")
    return _start_ray(host, places, *head, *more)


def start_node(host: Host, address: str, places: int, *more: str) -> "subprocess.Popen[bytes]":
    """Have a host join a cluster, and wait until it has. more: options of Ray."""
    return _start_ray(host, places, f"--address={address}", *more)


def start_store(host: Host) -> "subprocess.Popen[bytes]":
    """Start an S3 server on a host, with a bucket; nothing in it outlives it."""
    server = host.start("store", sys.executable, "-c", _STORE, str(STORE_PORT))
    wait_for(lambda: "bucket is there" in (host.logs / f"{host.name}-store.log").read_text(), 60)
    return server


def wait_for(is_so: Callable[[], object], limit_s: float, what: str = "it") -> None:
    """Wait until something is so. Raises TimeoutError."""
    deadline_s = time.monotonic() + limit_s
    while not is_so():
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"{what} did not come in {limit_s:g} s")
        time.sleep(0.1)


_STORE = """\
import sys, time, boto3
from moto.server import ThreadedMotoServer
server = ThreadedMotoServer(ip_address="10.77.0.1", port=int(sys.argv[1]), verbose=False)
server.start()
boto3.client("s3", endpoint_url=f"http://10.77.0.1:{sys.argv[1]}").create_bucket(Bucket="wil")
print("bucket is there", flush=True)
while True:
    time.sleep(60)
"""


def _store_access() -> dict[str, str]:
    return {
        "AWS_ENDPOINT_URL": f"http://10.77.0.1:{STORE_PORT}",
        "AWS_ACCESS_KEY_ID": "bench",
        "AWS_SECRET_ACCESS_KEY": "bench",
        "AWS_DEFAULT_REGION": "us-east-1",
    }


def _start_ray(host: Host, places: int, *options: str) -> "subprocess.Popen[bytes]":
    node = ("--node-ip-address", host.address, f"--num-cpus={places}", "--num-gpus=0", _OBJECTS)
    ray = (sys.executable, "-m", "ray.scripts.scripts", "start", "--block", "--disable-usage-stats")
    log = host.logs / f"{host.name}-ray.log"
    before = log.read_text().count("Ray runtime started") if log.exists() else 0
    process = host.start("ray", *ray, *node, *options)
    wait_for(
        lambda: log.read_text().count("Ray runtime started") > before,
        JOINED_S,
        f"Ray on {host.name}",
    )
    return process


@contextmanager
def _host(name: str, address: str, logs: Path) -> Iterator[Host]:
    """Have a host with namespaces and a /tmp of its own, ended with all that runs in it."""
    with tempfile.TemporaryDirectory(dir=logs, prefix=f"tmp-{name}-") as tmp:
        namespace = f"wil-{name}"
        _end_orphaned_host(namespace)
        _ip("netns", "add", namespace)
        holder: subprocess.Popen[bytes] | None = None
        try:
            ready = logs / f"{name}-is-up"
            script = (
                f"mount --bind {tmp} /tmp && hostname {name} && touch {ready} && exec sleep inf"
            )
            holder = subprocess.Popen(  # noqa: S603
                ["ip", "netns", "exec", namespace, "unshare", "-m", "-u", "sh", "-c", script]  # noqa: S607
            )
            wait_for(ready.exists, 10, name)
            yield Host(name, address, holder, logs)
        finally:
            _end_all(namespace)
            if holder is not None:
                holder.wait()
            _ip("netns", "del", namespace)


def _end_orphaned_host(namespace: str) -> None:
    """End what a bench that was killed has left of a host. Raises RuntimeError while one runs."""
    if not Path("/run/netns", namespace).exists():
        return
    for process in _processes_in(namespace):
        if process.cmdline()[:1] == ["sleep"] and process.ppid() != 1:
            raise RuntimeError(f"{namespace} is used by another bench (pid {process.ppid()})")
    _end_all(namespace)
    _ip("netns", "del", namespace)


def _end_all(namespace: str) -> None:
    """End every process of a host, what keeps it, too."""
    for _ in range(20):
        every = _processes_in(namespace)
        if not every:
            return
        for process in every:
            with contextlib.suppress(psutil.Error):
                process.kill()
        time.sleep(0.2)


def _processes_in(namespace: str) -> list[psutil.Process]:
    found = subprocess.run(  # noqa: S603
        ["ip", "netns", "pids", namespace],  # noqa: S607
        check=True,
        capture_output=True,
        text=True,
    )
    every: list[psutil.Process] = []
    for pid in map(int, found.stdout.split()):
        with contextlib.suppress(psutil.Error):
            process = psutil.Process(pid)
            if process.status() != psutil.STATUS_ZOMBIE:
                every.append(process)
    return every


@contextmanager
def ended_in_order() -> Iterator[None]:
    """Have SIGTERM and SIGHUP end this program as Ctrl-C does: with its hosts."""

    def interrupt(*_: object) -> None:
        for number in numbers:
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, interrupt) for number in numbers]
    try:
        yield
    finally:
        for number, one in zip(numbers, before, strict=True):
            signal.signal(number, one)


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True)  # noqa: S603, S607


def _line(process: psutil.Process) -> str:
    try:
        return " ".join(process.cmdline())
    except psutil.Error:
        return ""
