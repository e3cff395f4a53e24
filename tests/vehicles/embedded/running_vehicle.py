"""An embedded vehicle that is on already, as a process: what programs are attached to."""

import asyncio
import os
import signal
import sys
from asyncio.subprocess import Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings

ROOT = Path(__file__).parents[3]


@asynccontextmanager
async def running_vehicle(settings: ProcessSettings) -> AsyncIterator[Process]:
    """Run a vehicle; it may be ended or stopped meanwhile.

    It has a session of its own, as whatever flies: in that of the tests' workers, which yields to
    all others (tests/conftest.py), it came to stand still for most of a second.
    """
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "wil_campaign.vehicles.embedded", settings.model_dump_json()),
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        start_new_session=True,
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.send_signal(signal.SIGCONT)
            process.terminate()
        await process.wait()
