"""Runs a Foxglove bridge beside a campaign or a console, in a separate process."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from wil_campaign.plugins.console.process_beside import process_beside
from wil_campaign.plugins.foxglove.bridge_address import bridge_address
from wil_campaign.plugins.foxglove.bridge_process import REFUSED
from wil_campaign.plugins.foxglove.errors import BridgeError

_END_S = 4.0


@contextmanager
def foxglove_beside(
    address: str,
    say: Callable[[str], None],
    *,
    folder: Path | None = None,
    program: int | None = None,
) -> Iterator[None]:
    """Serve runs in flight to Foxglove until the context is left. say: receives the address.

    folder: only campaigns that write there; program: only the campaign of that process. Raises
    BridgeError before the context is entered.
    """
    bridge_address(address)
    arguments = ("-P", "-m", "wil_campaign.plugins.foxglove.bridge_process", address)
    only = (str(folder.absolute()) if folder else "", str(program) if program else "")
    with process_beside((*arguments, *only), lines=1, end_s=_END_S) as lines:
        line = lines[0].strip() if lines else ""
        if not line or line.startswith(REFUSED):
            raise BridgeError(line.removeprefix(REFUSED) or "the Foxglove bridge did not start")
        say(line)
        yield
