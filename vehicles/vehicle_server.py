"""The fork server of embedded vehicles: `python -m wil_campaign.vehicles.vehicle_server END`.

END is an inherited socket, see `serve`. It forks the vehicles of a campaign on the wall clock, each
of which would import and load kernels for a second.
"""

# ruff: noqa: E402 - the collector is off while it imports
import gc

gc.disable()  # a vehicle enables it once it has opened its link

import socket
import sys
from pathlib import Path

from wil_campaign.foundation.processes.fork_server import serve_forks
from wil_campaign.vehicles.embedded.emulations import emulations, load_kernels
from wil_campaign.vehicles.embedded.physics.motion_kernel import estimate_motion
from wil_campaign.vehicles.embedded.process.embedded_process import main as fly
from wil_campaign.worlds.jit import is_kernel_cached

_WORDS = 4
"""`python -P -m wil_campaign.vehicles.embedded`."""


def main(arguments: list[str]) -> int:
    """Serve until no client is left; return the exit code, 1 where a fork would not be safe."""
    emulations()  # imported
    if is_kernel_cached(estimate_motion):  # else the first vehicle compiles them
        load_kernels()
    gc.freeze()
    if len(tuple(Path("/proc/self/task").iterdir())) != 1:
        return 1
    return serve_forks(socket.socket(fileno=int(arguments[0])), fly, words=_WORDS)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
