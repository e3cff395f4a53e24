"""Waiting for an event of the guard with a timeout."""

import asyncio


async def happens(event: asyncio.Event, within_s: float) -> bool:
    """Wait until an event is set; return False if it is not set in time."""
    try:
        async with asyncio.timeout(within_s):
            await event.wait()
    except TimeoutError:
        return False
    return True
