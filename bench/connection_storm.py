"""Connects to a Unix socket so many times a second, says nothing, and keeps the last 200 open.

    python -m bench.connection_storm SOCKET RATE_HZ

For a minute at most; prints how many connections a second it came to, once it has settled.
"""

import asyncio
import contextlib
import socket
import sys
import time
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

_KEPT = 200
_SETTLED_S = 0.3


def main() -> None:
    """Connect until the guard has ended."""
    path, rate_hz = sys.argv[1], float(sys.argv[2])
    kept: deque[socket.socket] = deque()
    began_s, made, is_reported = time.monotonic(), 0, False
    with contextlib.suppress(OSError):  # the guard has ended
        while (after_s := time.monotonic() - began_s) < 60.0:
            while made < after_s * rate_hz:
                one = socket.socket(socket.AF_UNIX)
                one.connect(path)
                kept.append(one)
                made += 1
                if len(kept) > _KEPT:
                    kept.popleft().close()
            if after_s > _SETTLED_S and not is_reported:
                is_reported = True
                print(f"{made / after_s:.0f}", flush=True)
            time.sleep(0.001)


@asynccontextmanager
async def storm(path: str, rate_hz: float = 1000.0) -> AsyncIterator[float]:
    """Have another process connect to a socket meanwhile; gives the rate that it came to."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "bench.connection_storm", path, str(rate_hz)),
        stdout=asyncio.subprocess.PIPE,
    )
    try:
        settled = b"" if process.stdout is None else await process.stdout.readline()
        yield float(settled or 0.0)
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()


if __name__ == "__main__":
    main()
