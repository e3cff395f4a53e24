"""The program: `wil-campaign`, and `python -m wil_campaign` where that is not on the path."""

import atexit
import os
import sys
from collections.abc import Callable
from contextlib import suppress


def run_program() -> int:
    """Run the command line, and return its exit code.

    The process then ends after all exit handlers, without freeing its objects one by one, which
    takes a quarter of a second. The command line is imported here, because the process of each run
    imports the program's main module anew.
    """
    codes: list[int] = []
    if not _has_exit_handlers():
        atexit.register(_end_process, codes)  # the first that is registered is called last
    try:
        from wil_campaign.orchestrator.cli import main  # noqa: PLC0415 - as above
    except KeyboardInterrupt:  # later `main` handles it
        sys.stderr.write("interrupted\n")
        codes.append(130)
    else:
        codes.append(main())
    return codes[0]


def _has_exit_handlers() -> bool:
    """Return whether anything before us has exit handlers, as what measures coverage does."""
    count: Callable[[], int] = getattr(atexit, "_ncallbacks", lambda: 1)
    return count() > 0


def _end_process(codes: list[int]) -> None:
    """End this process with the code that the command line returned, once all is written."""
    with suppress(OSError, ValueError):  # Python reports a stream that cannot be written
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
        if codes:
            os._exit(codes[0])


if __name__ == "__main__":
    sys.exit(run_program())
