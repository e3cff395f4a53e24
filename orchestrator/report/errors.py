"""Why there is no report."""


class ReportError(Exception):
    """A folder of which no report can be made; says why, and what to give instead."""
