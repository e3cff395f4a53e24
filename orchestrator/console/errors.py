"""The error of the console."""


class ConsoleError(Exception):
    """A console cannot be opened; the message says why, and what to do."""
