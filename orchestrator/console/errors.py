"""What can go wrong with a console."""


class ConsoleError(Exception):
    """A console that cannot be opened; says why, and what to do."""
