"""Errors of reading and comparing results folders."""


class ResultsFolderError(Exception):
    """A folder is not the results folder of a campaign; the message says what to give instead."""


class ComparisonError(Exception):
    """Campaigns cannot be compared; the message says why."""
