"""Waiting for what the guard sees."""

import asyncio


async def happens(event: asyncio.Event, within_s: float) -> bool:
    """Wait until an event is set; return False when it is not within a time."""
    try:
        async with asyncio.timeout(within_s):
            await event.wait()
    except TimeoutError:
        return False
    return True
