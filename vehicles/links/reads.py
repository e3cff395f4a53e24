"""How much asyncio reads from a socket at once."""

import asyncio
from typing import Protocol, cast

LONGEST_READ_BYTES = 1 << 16
"""No UDP datagram is longer."""


class _Reads(Protocol):
    max_size: int


def shorten_reads(transport: asyncio.BaseTransport) -> None:
    """Have asyncio ask a socket for 64 KiB at a time and not for 256.

    It takes memory for as much as it asks for. Above 128 KiB malloc gets it from the kernel, page
    by page, and gives it back: that costs four times as much as reading a short datagram.
    """
    if hasattr(transport, "max_size"):
        cast("_Reads", transport).max_size = LONGEST_READ_BYTES
