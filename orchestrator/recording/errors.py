"""What can be wrong with a recording."""


class RecordingError(Exception):
    """A recording that cannot be read, or not be judged again; says which file, and why."""
