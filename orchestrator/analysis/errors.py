"""Errors of reading and comparing results folders."""


class ResultsFolderError(Exception):
    """A folder that is no results folder of a campaign; says why, and what to give instead."""


class ComparisonError(Exception):
    """Campaigns that cannot be compared; says why."""
