"""The Ray node of a bench's machine: Ray's processes, which end with the bench's server.

Run as a program, this module is `ray`, and ends with its parent: a bench whose server was killed
is no longer announced.
"""

import ipaddress
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wil_campaign.campaigns.setup.bench_file import BenchFacts
from wil_campaign.foundation.processes.linux import die_with_parent
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.plugins.cluster.bench.bench_messages import SOCKET_VARIABLE
from wil_campaign.plugins.cluster.bench.bench_resources import announced_resources

_JOIN_S = 90.0
_POLL_S = 0.5
_JOINED_TEXT = "Ray runtime started"
"""In the output of a node that has joined."""
_END_S = 30.0


@contextmanager
def bench_node(
    address: str, facts: BenchFacts, server: Path
) -> Iterator["subprocess.Popen[bytes]"]:
    """Make this machine a node of a cluster, with a bench and no other place for runs.

    server: the socket of the bench's server. Yields the process of the node. Raises EngineError.
    """
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(  # noqa: S603  # our own interpreter
            [
                *(
                    sys.executable,
                    "-P",
                    "-m",
                    "wil_campaign.plugins.cluster.bench.bench_node",
                    "start",
                    "--block",
                ),
                *(f"--address={address}", "--num-cpus=0", "--num-gpus=0", *_own_address(address)),
                f"--resources={json.dumps(announced_resources(facts))}",
                "--disable-usage-stats",
            ],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            # Ctrl-C at the terminal goes to the server, which lands first, then ends the node.
            start_new_session=True,
            env={**os.environ, SOCKET_VARIABLE: str(server), "RAY_worker_niceness": "0"},
        )
        try:
            _require_joined(process, address, output.fileno())
            yield process
        finally:
            process.terminate()
            try:
                process.wait(_END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _own_address(address: str) -> list[str]:
    """Return Ray's option with this machine's address towards a cluster; none on loopback.

    On a network without a default route Ray would take 127.0.0.1.
    """
    host, _, port = address.rpartition(":")
    try:
        family, kind, _, _, where = socket.getaddrinfo(host, int(port), type=socket.SOCK_DGRAM)[0]
        with socket.socket(family, kind) as end:
            end.connect(where)  # of datagrams: nothing is sent
            own = str(end.getsockname()[0])
    except OSError:
        return []  # Ray's own error says what is wrong with the address
    return [] if ipaddress.ip_address(own).is_loopback else [f"--node-ip-address={own}"]


def _require_joined(process: "subprocess.Popen[bytes]", address: str, output: int) -> None:
    """Wait until a node has joined. Raises EngineError if it ends or hangs."""
    due_s = time.monotonic() + _JOIN_S
    while process.poll() is None and time.monotonic() < due_s:
        if _JOINED_TEXT in _text_of(output):
            return
        time.sleep(_POLL_S)
    text = _text_of(output).strip()
    last = text.splitlines()[-1].strip() if text else "it printed nothing"
    raise EngineError(
        f"cannot join the Ray cluster at {address}: {last}; start its head first with ray "
        "start --head, with the same token and the same versions of Ray and Python"
    )


def _text_of(output: int) -> str:
    return os.pread(output, 1_000_000, 0).decode(errors="replace")


def main() -> int:
    """Run the program `ray` for as long as the parent process lives."""
    die_with_parent(signal.SIGTERM)
    from ray.scripts.scripts import main as ray_main  # noqa: PLC0415  # of an extra

    ray_main()
    return 0


if __name__ == "__main__":
    sys.exit(main())
