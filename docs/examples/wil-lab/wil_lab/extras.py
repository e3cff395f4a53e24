import subprocess
import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from wil_campaign import RecordedReading, Recording
from wil_campaign.api import Masked, SidedParameters, step


class BiasParameters(SidedParameters):
    """north_ut: added to the reading's x."""

    north_ut: float


@step("bias", stage="transform", sensors=("magnetometer",), parameters=BiasParameters)
def bias(parameters, context):
    """Add to the strength of the field."""

    def operate(work, other):
        reading = work.reading
        return Masked(replace(reading, x_ut=reading.x_ut + parameters.north_ut), work.mask)

    return operate


@contextmanager
def logbook(address, say, *, folder=None, program=None):
    with Path(address).open("w", encoding="utf-8") as file:
        words = [sys.executable, "-P", "-m", "wil_campaign", "watch", "--json"]
        words += [str(folder)] if folder else []
        watch = subprocess.Popen(words, stdout=file, stderr=subprocess.DEVNULL)
        say(f"logbook: {address}")
        try:
            yield
        finally:
            watch.terminate()
            watch.wait()


def readings(run: Path) -> int:
    """Count the readings of a recorded run. run: its folder."""
    if not (run / "run.mcap").exists():
        print(f"{run} has no run.mcap")
        return 2
    print(sum(isinstance(item, RecordedReading) for item in Recording(run / "run.mcap")))
    return 0
