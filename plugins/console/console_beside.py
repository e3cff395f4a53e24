"""Runs a console beside a campaign, in a separate process that cannot delay a flight."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from wil_campaign.plugins.console.console_address import (
    ConsoleAddress,
    ConsoleError,
    ConsoleOptionError,
    require_safe_console_address,
)
from wil_campaign.plugins.console.process_beside import process_beside

AUTO = "auto"
LOOPBACK = "127.0.0.1"
LINKS = 2
"""Links that a console prints once it serves: for operators and for viewers."""
_END_S = 8.0
"""How long the console may show the last verdict after the campaign."""


def server_options(text: str) -> tuple[str, ...]:
    """Return the options of the command `console` for ADDRESS or ADDRESS,CERTIFICATE,KEY.

    Raises OptionError.
    """
    given, *tls = text.split(",")
    if tls and (len(tls) != 2 or not all(tls)):
        raise ConsoleOptionError(f"--console {text}: give ADDRESS, or ADDRESS,CERTIFICATE,KEY")
    address = LOOPBACK if given == AUTO else given
    require_safe_console_address(ConsoleAddress.parse(address), tls=bool(tls))
    files = ("--tls-cert", tls[0], "--tls-key", tls[1]) if tls else ()
    return ("--address", address, *files)


@contextmanager
def console_beside(
    address: str, say: Callable[[str], None], *, program: int, **_: object
) -> Iterator[None]:
    """Run a console until the context is left. say: receives its links.

    address: or auto; before two more values by commas, the certificate and its key.
    program: the process whose campaign is shown. If it dies, the console runs until the guards have
    landed. Raises ConsoleError.
    """
    beside = (*server_options(address), "--beside", str(program))
    arguments = ("-P", "-m", "wil_campaign", "console", *beside)
    with process_beside(arguments, lines=LINKS, end_s=_END_S) as lines:
        if len(lines) < LINKS:
            raise ConsoleError("the console did not start; nothing flies")
        for line in lines:
            say(line)
        yield
