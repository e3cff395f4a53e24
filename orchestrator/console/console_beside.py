"""Runs a console beside a campaign, in a separate process that cannot delay a flight."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from orchestrator.console.errors import ConsoleError
from orchestrator.live_feed.process_beside import process_beside

LINKS = 2
"""Links that a console prints once it serves: for operators and for viewers."""
_END_S = 8.0
"""How long the console may show the last verdict after the campaign."""


@contextmanager
def console_beside(address: str, say: Callable[[str], None]) -> Iterator[None]:
    """Run a console at an address until the context is left. say: receives its links.

    If this program dies, the console runs until the guards have landed. Raises ConsoleError.
    """
    beside = ("--address", address, "--beside", str(os.getpid()))
    arguments = ("-P", "-m", "orchestrator.cli", "console", *beside)
    with process_beside(arguments, lines=LINKS, end_s=_END_S) as lines:
        if len(lines) < LINKS:
            raise ConsoleError("the console did not start; nothing flies")
        for line in lines:
            say(line)
        yield
