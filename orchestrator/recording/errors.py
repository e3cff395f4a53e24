"""Errors of recordings."""


class RecordingError(Exception):
    """A recording cannot be read or judged again; says which file, and why."""
