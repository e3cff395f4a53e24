"""What can go wrong with the ways for operators."""


class OperatingError(Exception):
    """An operator channel of the campaign is unavailable; says which and why."""
