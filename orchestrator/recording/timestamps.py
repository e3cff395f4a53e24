"""UTC timestamps of recordings; runs in virtual time have a fixed epoch."""

from datetime import UTC, datetime

VIRTUAL_EPOCH_S = 1_767_225_600.0
"""2026-01-01T00:00:00Z: runs in virtual time are stamped from here, so that repeats are equal."""


def utc_text(epoch_s: float) -> str:
    """Return a UTC timestamp in ISO 8601, to the second."""
    return datetime.fromtimestamp(epoch_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def folder_stamp(epoch_s: float) -> str:
    """Return a UTC timestamp as the name of a folder."""
    return datetime.fromtimestamp(epoch_s, UTC).strftime("%Y%m%dT%H%M%SZ")
