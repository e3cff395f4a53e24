"""An embedded vehicle that is on already, as a process: what programs are attached to."""

import os
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from tests.forks import ROOT, Forked, fork_program
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings


@asynccontextmanager
async def running_vehicle(settings: ProcessSettings) -> AsyncIterator[Forked]:
    """Run a vehicle; it may be ended or stopped meanwhile.

    It has a session of its own, as whatever flies: in that of the tests' workers, which yields to
    all others (tests/conftest.py), it came to stand still for most of a second.
    """
    process = await fork_program(
        *("-m", "wil_campaign.vehicles.embedded", settings.model_dump_json()),
        environment={**os.environ, "PYTHONPATH": str(ROOT)},
        piped=False,
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.send_signal(signal.SIGCONT)
            process.terminate()
        await process.wait()
