"""Links from a page to the reports of results folders."""

import os
from pathlib import Path
from urllib.parse import quote

REPORT = "report.html"


def link_from(page: str | Path, report: Path) -> str:
    """Return the relative link from a page to a report, which stays when both move together."""
    relative = os.path.relpath(report.absolute(), Path(page).absolute().parent)
    return quote(Path(relative).as_posix())
