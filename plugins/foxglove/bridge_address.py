"""The address of the Foxglove server: loopback only, because it has no token."""

from wil_campaign.plugins.console.console_address import ConsoleAddress, ConsoleError
from wil_campaign.plugins.foxglove.errors import BridgeError

AUTO = "auto"
PORT = 8765
"""Foxglove's default port."""


def bridge_address(text: str) -> ConsoleAddress:
    """Return the address in HOST, HOST:PORT, :PORT or auto. Raises BridgeError."""
    try:
        address = ConsoleAddress.parse("" if text == AUTO else text, port=PORT)
    except ConsoleError as error:
        raise BridgeError(
            f"{text!r} is not an address for Foxglove: give HOST, :PORT or HOST:PORT, or auto for "
            f"127.0.0.1:{PORT}"
        ) from error
    if not address.is_loopback:
        raise BridgeError(
            f"{address.host} can be reached by other machines, and Foxglove has no access token: "
            f"use a loopback address, and forward the port (ssh -L "
            f"{address.port}:127.0.0.1:{address.port} HOST)"
        )
    return address
