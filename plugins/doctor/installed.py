"""Checks of Python, of required packages, and of packages that conflict with wil-campaign."""

import os
import platform
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import PackageNotFoundError, requires, version

from wil_campaign import hooks
from wil_campaign.foundation.files.problems import BadInput
from wil_campaign.foundation.processes.linux import usable_cores
from wil_campaign.hooks import VehicleDriver
from wil_campaign.installed_plugins import (
    installed_plugins_by_name,
    plugin_additions,
    third_party_plugins,
)
from wil_campaign.plugins.doctor.findings import Finding
from wil_campaign.recipes.model.registry import registered_steps
from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.vehicles.readings.kinds import sensor_specs

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
    needed = dict(sorted(_required_packages(requirements(_PACKAGE) or [])))
    missing = [name for name in needed if not is_package_installed(name, find)]
    if missing:
        text = f"{_PACKAGE} {own} lacks {', '.join(missing)}"
        yield Finding(TOPIC, "trouble", text, f"pip install {_quoted(needed, missing)}")
    others = [
        name for name in needed if name not in missing and not _fits(needed[name], find(name))
    ]
    for name in others:
        text = f"{_PACKAGE} {own} needs {needed[name]}; {name} {find(name)} is installed"
        yield Finding(TOPIC, "trouble", text, f"pip install '{needed[name]}'")
    if not missing and not others:
        text = f"{_PACKAGE} {own} with the {len(needed)} packages that it needs"
        yield Finding(TOPIC, "good", text)


def plugin_findings() -> Iterator[Finding]:
    """Yield the finding on plugins of other distributions: whether campaigns can use them."""
    try:
        installed_plugins_by_name()
        oracle_kinds(), registered_steps(), sensor_specs()
    except BadInput as error:
        yield Finding(TOPIC, "trouble", str(error.problems[0]))
        return
    if others := third_party_plugins():
        named = ", ".join(f"{name} ({origin})" for name, origin in others.items())
        yield Finding(TOPIC, "good", f"plugins of others: {named}")


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


def _quoted(needed: Mapping[str, str], names: list[str]) -> str:
    return " ".join(f"'{needed[name]}'" for name in names)


def _required_packages(requirements: list[str]) -> Iterator[tuple[str, str]]:
    """Yield name and requirement of each package that this machine needs, without extras."""
    for requirement in requirements:
        needed, _, marker = map(str.strip, requirement.partition(";"))
        left_out = re.fullmatch(r"platform_machine != ['\"](\w+)['\"]", marker)
        if "extra ==" not in marker and not (left_out and left_out[1] == platform.machine()):
            yield package_of_requirement(needed), needed


def _fits(requirement: str, installed: str) -> bool:
    """Return whether a version is within the bounds (>= and <) of a requirement."""
    has = _numbers(installed)
    bounds = re.findall(r"(>=|<)\s*([\d.]+)", requirement)
    return all((has >= _numbers(at)) == (sign == ">=") for sign, at in bounds)


def _numbers(version: str) -> tuple[int, ...]:
    found = re.match(r"\d+(?:\.\d+)*", version)
    return tuple(map(int, found[0].split("."))) if found else ()


def is_package_installed(name: str, find: Version = version) -> bool:
    """Return whether a package is installed."""
    try:
        find(name)
    except PackageNotFoundError:
        return False
    return True
