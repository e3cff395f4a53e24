"""A camera from outside that delivers nothing: the reason of the run names the commonest cause."""

import asyncio
from typing import Any

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.external.external_io import ExternalIo

HANGS = "the simulator did not answer in 0.2 s"
KEY = ("twin", "camera")


async def stalled(reasons: list[str]) -> list[str]:
    """Return what is said of a camera whose images fail by these reasons, ten a second."""
    setup: Any = type("Setup", (), {"with_sensors": (), "vehicles": (), "mode": "sim"})()
    outside = ExternalIo.__new__(ExternalIo)
    said: list[str] = []
    outside._missing, outside._on_stall, outside._setup = {}, said.append, setup
    for reason in reasons:
        outside.missing(KEY, reason)
        await asyncio.sleep(0.1)
    return said


def test_the_commonest_reason_is_named_and_not_the_latest() -> None:
    said = run_virtual(stalled([HANGS] * 11 + ["no simulator is connected"]))
    assert said == [f"twin camera: {HANGS} (11 of 12 images)"]


def test_reasons_that_differ_by_a_number_are_one() -> None:
    wrong = [f"it is from another pose: {n}.25 m away" for n in range(8)]
    said = run_virtual(stalled([HANGS] * 4 + wrong))
    assert said == ["twin camera: it is from another pose: 7.25 m away (8 of 12 images)"]
    assert run_virtual(stalled(wrong + wrong[:4])) == [
        "twin camera: it is from another pose: 3.25 m away"
    ]
