"""Errors of the operator channels."""


class OperatingError(Exception):
    """An operator channel of the campaign is unavailable; says which and why."""
