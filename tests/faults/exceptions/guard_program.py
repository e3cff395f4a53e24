"""A guard's process in which an exception is raised: started in place of the product's.

WIL_PROBE: a JSON object, {injection, counts}: what is raised (null for nothing), and the file to
which the points are written that were passed.
"""

import asyncio
import json
import os
import pickle
import socket
import sys
from base64 import b64decode
from pathlib import Path

from tests.faults.exceptions.injection import InjectingWallLoop, Probe, protocols_pass_by
from wil_campaign.safety.guard.process.guard_process import GuardProcess


def main(arguments: list[str]) -> int:
    """Guard as the product's `main` does, in a loop that raises."""
    channel, lifeline, hold = (int(argument) for argument in arguments[:3])
    os.set_inheritable(hold, False)
    end = socket.socket(fileno=channel)
    end.set_inheritable(False)
    asked = json.loads(os.environ["WIL_PROBE"])
    probe = Probe(pickle.loads(b64decode(asked["injection"])))  # noqa: S301 - of our parent
    guard: list[GuardProcess] = []

    def stage() -> str:
        return "guarding" if guard and guard[0]._guarding else "not guarding"

    async def run() -> int:
        guard.append(GuardProcess(end=end, lifeline=lifeline))
        return await guard[0].run()

    probe.stage = stage
    try:
        with (
            protocols_pass_by(probe),
            asyncio.Runner(loop_factory=lambda: InjectingWallLoop(probe)) as runner,
        ):
            return runner.run(run())
    finally:
        Path(asked["counts"]).write_bytes(pickle.dumps((probe.counts, probe.raised)))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
