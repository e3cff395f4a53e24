"""A console beside a campaign: a process of its own, so that no page holds up a flight."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from orchestrator.console.errors import ConsoleError
from orchestrator.live_feed.process_beside import process_beside

LINKS = 2
"""Lines that a console prints once it serves: for the operator, for viewers."""
_END_S = 8.0
"""So long its pages may show the last verdict."""


@contextmanager
def console_beside(address: str, say: Callable[[str], None]) -> Iterator[None]:
    """Have a console at an address until the context is left. say: is given its links.

    It outlives a program that dies, until its guards have landed. Raises ConsoleError.
    """
    beside = ("--address", address, "--beside", str(os.getpid()))
    arguments = ("-m", "orchestrator.cli", "console", *beside)
    with process_beside(arguments, lines=LINKS, end_s=_END_S) as lines:
        if len(lines) < LINKS:
            raise ConsoleError("the console was not opened; nothing flies")
        for line in lines:
            say(line)
        yield
