"""Checks of Python, of required packages, and of packages that conflict with wil-campaign."""

import platform
import re
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, requires, version

from orchestrator.doctor.findings import Finding
from vehicles.processes.linux import usable_cores

TOPIC = "installed"
_OLDEST = (3, 11)
_PACKAGE = "wil-campaign"
MAVSDK_REMEDY = "vehicles with driver: mavsdk need it: pip install 'mavsdk>=4.1,<5'"
Version = Callable[[str], str]
"""Returns the version of an installed package; raises PackageNotFoundError."""
Requirements = Callable[[str], list[str] | None]
"""Returns the requirements of an installed package."""


def python() -> Iterator[Finding]:
    """Yield the finding on the installed Python and the machine."""
    text = (
        f"Python {platform.python_version()} on {platform.system()} {platform.machine()}, "
        f"{usable_cores()} cores"
    )
    if sys.version_info < _OLDEST:
        yield Finding(TOPIC, "trouble", text, "install Python 3.11 or later")
    elif not sys.platform.startswith("linux"):
        remedy = "use Linux: only there a crash is certain to end all processes of a run"
        yield Finding(TOPIC, "note", text, remedy)
    else:
        yield Finding(TOPIC, "good", text)


def packages(find: Version = version, requirements: Requirements = requires) -> Iterator[Finding]:
    """Yield the finding on required packages."""
    try:
        own = find(_PACKAGE)
    except PackageNotFoundError:
        text = f"{_PACKAGE} runs from a folder and is not installed"
        yield Finding(TOPIC, "note", text, "install it: pip install -e . in its folder")
        return
    needed = sorted(_required_packages(requirements(_PACKAGE) or []))
    missing = [name for name in needed if not _is_there(name, find)]
    if missing:
        text = f"{_PACKAGE} {own} lacks {', '.join(missing)}"
        yield Finding(TOPIC, "trouble", text, f"pip install {' '.join(missing)}")
    else:
        text = f"{_PACKAGE} {own} with the {len(needed)} packages that it needs"
        yield Finding(TOPIC, "good", text)


def drivers(find: Version = version) -> Iterator[Finding]:
    """Yield the finding whether mavsdk is installed."""
    try:
        yield Finding(TOPIC, "good", f"mavsdk {find('mavsdk')}, for vehicles with driver: mavsdk")
    except PackageNotFoundError:
        text = "mavsdk is not installed; the driver mavlink does not need it"
        yield Finding(TOPIC, "note", text, MAVSDK_REMEDY)


def foreign_packages(find: Version = version) -> Iterator[Finding]:
    """Yield findings on installed packages that conflict with wil-campaign."""
    if _is_there("safety", find):
        yield Finding(
            TOPIC,
            "trouble",
            "the package 'safety' is installed: it hides the module of that name in wil-campaign",
            "pip uninstall safety, or install wil-campaign into an environment of its own",
        )


def _required_packages(requirements: list[str]) -> Iterator[str]:
    """Yield the names of the packages that must be installed."""
    for one in requirements:
        if "extra ==" not in one:
            yield re.split(r"[^A-Za-z0-9._-]", one, maxsplit=1)[0]


def _is_there(name: str, find: Version) -> bool:
    """Return whether a package is installed."""
    try:
        find(name)
    except PackageNotFoundError:
        return False
    return True
