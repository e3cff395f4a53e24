"""Python, our own packages, and those that spoil ours."""

import platform
import re
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, requires, version

from orchestrator.doctor.findings import Finding
from vehicles.processes.linux import usable_cores

TOPIC = "installed"
_OLDEST = (3, 11)
_US = "wil-campaign"
Version = Callable[[str], str]
"""Gives the version of an installed package; raises PackageNotFoundError."""
Requirements = Callable[[str], list[str] | None]
"""Gives what an installed package says that it needs."""


def python() -> Iterator[Finding]:
    """Yield the finding on the installed Python and the machine."""
    text = (
        f"Python {platform.python_version()} on {platform.system()} {platform.machine()}, "
        f"{usable_cores()} cores"
    )
    if sys.version_info < _OLDEST:
        yield Finding(TOPIC, "trouble", text, "install Python 3.11 or later")
    elif not sys.platform.startswith("linux"):
        said = "processes of a run that crashes are ended for certain on Linux alone"
        yield Finding(TOPIC, "note", text, said)
    else:
        yield Finding(TOPIC, "good", text)


def packages(find: Version = version, requirements: Requirements = requires) -> Iterator[Finding]:
    """Yield findings on required packages that are not installed."""
    try:
        own = find(_US)
    except PackageNotFoundError:
        said = "install it: pip install -e . in its folder"
        yield Finding(TOPIC, "note", f"{_US} runs from a folder, not installed", said)
        return
    needed = sorted(_required_packages(requirements(_US) or []))
    missing = [name for name in needed if not _is_there(name, find)]
    if missing:
        text = f"{_US} {own} lacks {', '.join(missing)}"
        yield Finding(TOPIC, "trouble", text, f"pip install {' '.join(missing)}")
    else:
        yield Finding(TOPIC, "good", f"{_US} {own} with the {len(needed)} packages that it needs")


def drivers(find: Version = version) -> Iterator[Finding]:
    """Yield the finding whether mavsdk is installed to fly vehicles."""
    try:
        yield Finding(TOPIC, "good", f"mavsdk {find('mavsdk')}, for vehicles with driver: mavsdk")
    except PackageNotFoundError:
        said = "vehicles with driver: mavsdk need it: pip install 'mavsdk>=4.1,<5'"
        yield Finding(TOPIC, "note", "no mavsdk; the driver mavlink needs none", said)


def foreign_packages(find: Version = version) -> Iterator[Finding]:
    """Yield findings on installed packages that conflict with ours."""
    if _is_there("safety", find):
        yield Finding(
            TOPIC,
            "trouble",
            "the package 'safety' is installed: its module hides ours of that name",
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
