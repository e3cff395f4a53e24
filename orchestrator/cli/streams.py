"""Standard output and standard error, the one place where the command line writes to them."""

import sys


def out(text: object) -> None:
    """Write a line of what was asked for."""
    sys.stdout.write(f"{text}\n")


def err(text: object) -> None:
    """Write a line that is about the work rather than its result."""
    sys.stderr.write(f"{text}\n")
