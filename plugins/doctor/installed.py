"""Checks of Python, of required packages, and of packages that conflict with wil-campaign."""

import os
import platform
import re
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, requires, version

from wil_campaign import hooks
from wil_campaign.foundation.processes.linux import usable_cores
from wil_campaign.hooks import VehicleDriver
from wil_campaign.installed_plugins import plugin_additions
from wil_campaign.plugins.doctor.findings import Finding

TOPIC = "installed"
_OLDEST = (3, 11)
_PACKAGE = "wil-campaign"
Version = Callable[[str], str]
"""Returns the version of an installed package; raises PackageNotFoundError."""
Requirements = Callable[[str], list[str] | None]
"""Returns the requirements of an installed package."""


def python_finding() -> Iterator[Finding]:
    """Yield the finding on the installed Python and the machine."""
    usable, there = usable_cores(), os.cpu_count() or 1
    cores = f"{usable} cores" if usable >= there else f"may use {usable} of {there} cores"
    python = f"Python {platform.python_version()}"
    text = f"{python} on {platform.system()} {platform.machine()}, {cores}"
    if sys.version_info < _OLDEST:
        yield Finding(TOPIC, "trouble", text, "install Python 3.11 or later")
    elif not sys.platform.startswith("linux"):
        remedy = "use Linux: only there a crash is certain to end all processes of a run"
        yield Finding(TOPIC, "note", text, remedy)
    else:
        yield Finding(TOPIC, "good", text)


def package_findings(
    find: Version = version, requirements: Requirements = requires
) -> Iterator[Finding]:
    """Yield the finding on required packages."""
    try:
        own = find(_PACKAGE)
    except PackageNotFoundError:
        text = f"{_PACKAGE} runs from a folder and is not installed"
        yield Finding(TOPIC, "note", text, "install it: pip install -e . in its folder")
        return
    needed = sorted(_required_packages(requirements(_PACKAGE) or []))
    missing = [name for name in needed if not is_package_installed(name, find)]
    if missing:
        text = f"{_PACKAGE} {own} lacks {', '.join(missing)}"
        yield Finding(TOPIC, "trouble", text, f"pip install {' '.join(missing)}")
    else:
        text = f"{_PACKAGE} {own} with the {len(needed)} packages that it needs"
        yield Finding(TOPIC, "good", text)


def driver_findings(find: Version = version) -> Iterator[Finding]:
    """Yield the findings whether the packages of the plugins' drivers are installed."""
    for driver in plugin_additions(hooks.drivers).values():
        package = package_of_requirement(driver.requirement)
        try:
            text = f"{package} {find(package)}, for vehicles with driver: {driver.name}"
            yield Finding(TOPIC, "good", text)
        except PackageNotFoundError:
            text = f"{package} is not installed; the driver mavlink does not need it"
            yield Finding(TOPIC, "note", text, driver_remedy(driver))


def driver_remedy(driver: VehicleDriver) -> str:
    """Return how the package of a plugin's driver is installed."""
    return f"vehicles with driver: {driver.name} need it: pip install '{driver.requirement}'"


def package_of_requirement(requirement: str) -> str:
    """Return the package that a requirement names, as pip reads it."""
    return re.split(r"[^A-Za-z0-9._-]", requirement, maxsplit=1)[0]


def _required_packages(requirements: list[str]) -> Iterator[str]:
    for requirement in requirements:
        if "extra ==" not in requirement:
            yield package_of_requirement(requirement)


def is_package_installed(name: str, find: Version = version) -> bool:
    """Return whether a package is installed."""
    try:
        find(name)
    except PackageNotFoundError:
        return False
    return True
