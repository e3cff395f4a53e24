"""What a program's signals do while its loop has them, and afterwards."""

import asyncio
import os
import signal
from collections.abc import Iterator
from contextlib import suppress

import pytest

from wil_campaign.foundation.processes.interrupts import signals_call

NUMBERS = (signal.SIGTERM, signal.SIGHUP)


@pytest.fixture(autouse=True)
def signals_as_before() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in NUMBERS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_signals_do_again_what_they_did_before() -> None:
    heard: list[str] = []
    signal.signal(signal.SIGTERM, lambda *_: heard.append("the program"))
    signal.signal(signal.SIGHUP, signal.SIG_IGN)

    async def look() -> None:
        calls = dict.fromkeys(NUMBERS, lambda: heard.append("the loop"))
        with suppress(RuntimeError), signals_call(calls):
            os.kill(os.getpid(), signal.SIGTERM)
            os.kill(os.getpid(), signal.SIGHUP)  # which nohup has ignored
            await asyncio.sleep(0.01)
            raise RuntimeError
        assert heard == ["the loop"]
        os.kill(os.getpid(), signal.SIGTERM)
        await asyncio.sleep(0.01)

    asyncio.run(look())
    assert heard == ["the loop", "the program"]
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
