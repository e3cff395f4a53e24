"""What can go wrong with the ways for operators."""


class OperatingError(Exception):
    """A way for operators that the campaign asks for cannot be had; says which and why."""
