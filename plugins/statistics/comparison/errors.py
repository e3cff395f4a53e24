"""Errors of comparing campaigns."""


class ComparisonError(Exception):
    """Campaigns cannot be compared; the message says why."""
