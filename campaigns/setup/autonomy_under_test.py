"""The autonomy under test: found by name or reference, and built for a run."""

import importlib
import inspect
import pkgutil
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from wil_campaign.campaigns.values.autonomy_limits import AutonomyLimits
from wil_campaign.campaigns.values.references import BadReferenceError, is_reference, load_reference
from wil_campaign.foundation.files.documents import Document, Problem, closest_word
from wil_campaign.hooks import autonomy_kinds
from wil_campaign.installed_plugins import plugin_additions
from wil_campaign.vehicles.autonomy import Autonomy, AutonomyFactory

_METHODS = ("perceive", "act")


@dataclass(frozen=True, slots=True)
class ShippedAutonomy:
    """An autonomy that comes with the program. name: what `use` may name."""

    name: str
    summary: str
    factory: AutonomyFactory


class ForeignAutonomy(ABC):
    """An autonomy that is no class of Python, by a plugin; picklable, a base."""

    __slots__ = ()

    @property
    @abstractmethod
    def kind(self) -> str:
        """Return its key of `autonomy` in a campaign, which is its noun as well."""

    @property
    @abstractmethod
    def text(self) -> str:
        """Return what it is in messages, as "the program python3"."""

    @property
    def needs_wall_clock(self) -> bool:
        """Return whether it runs in real time: no time waits for it."""
        return True

    @property
    def is_shared(self) -> bool:
        """Return whether there is one of it, which all runs share."""
        return True

    @abstractmethod
    def problems(self, file: Document, folder: Path) -> list[Problem]:
        """Return what is wrong with it. folder: to which its files are relative."""


@dataclass(frozen=True, slots=True)
class UnderTest:
    """The autonomy under test as a campaign configures it; picklable.

    use: as in the file; None for a foreign one. folder: to which files are relative, and in which a
    foreign one runs. goal: what the autonomy receives of it. rate_hz: of its actions. foreign: one
    that is no class of Python. limits: of memory and time.
    """

    use: str | None
    folder: Path
    rate_hz: float
    parameters: Mapping[str, object] = field(default_factory=dict)
    goal: Mapping[str, float | str] = field(default_factory=dict)
    foreign: ForeignAutonomy | None = None
    limits: AutonomyLimits = field(default_factory=AutonomyLimits)

    @property
    def has_runner(self) -> bool:
        """Return whether a plugin's runner flies it; the run calls any other autonomy."""
        return (
            self.foreign is not None
            and plugin_additions(autonomy_kinds)[self.foreign.kind].runner != ""
        )

    @property
    def code_folder(self) -> Path | None:
        """Return the folder of the user's file; None for a shipped autonomy or a foreign one."""
        if self.use is None or not is_reference(self.use):
            return None
        return (self.folder / self.use.rpartition(":")[0]).resolve().parent

    def build(self, seed: int, parameters: dict[str, object] | None = None) -> Autonomy:
        """Return a new autonomy under test for one vehicle of one run.

        parameters: what it is given in place of a copy of its own ones, equal to them.
        Raises BadReferenceError when it cannot be found, and whatever its constructor raises.
        """
        if self.use is None:
            kind = "foreign autonomy" if self.foreign is None else self.foreign.kind
            raise BadReferenceError(f"a {kind} is started, not built")
        factory = find_autonomy(self.use, self.folder)
        given = dict(self.parameters) if parameters is None else parameters
        return factory(goal=dict(self.goal), parameters=given, seed=seed)


def find_autonomy(use: str, folder: Path) -> AutonomyFactory:
    """Return the class or function that `use` names. Raises BadReferenceError."""
    if is_reference(use):
        return _check_autonomy(load_reference(use, folder), use)
    shipped = {autonomy.name: autonomy.factory for autonomy in shipped_autonomies()}
    if use not in shipped:
        known = ", ".join(shipped)
        message = f"there is no autonomy '{use}' (there are {known}; or give file.py:Class)"
        raise BadReferenceError(message, closest_word(use, shipped))
    return shipped[use]


def shipped_autonomies() -> tuple[ShippedAutonomy, ...]:
    """Return the autonomies of campaigns/autonomies: public classes that perceive and act."""
    package = importlib.import_module("wil_campaign.campaigns.autonomies")
    found: list[ShippedAutonomy] = []
    for info in sorted(pkgutil.iter_modules(package.__path__), key=lambda info: info.name):
        module = importlib.import_module(f"wil_campaign.campaigns.autonomies.{info.name}")
        for name, value in sorted(vars(module).items()):
            own = inspect.isclass(value) and value.__module__ == module.__name__
            if own and not name.startswith("_") and _lacks(value) == "":
                summary = (inspect.getdoc(value) or "").partition("\n")[0]
                found.append(ShippedAutonomy(info.name, summary, value))
    return tuple(found)


def _check_autonomy(found: object, use: str) -> AutonomyFactory:
    if not callable(found):
        raise BadReferenceError(f"'{use}' is neither a class nor a function")
    lacking = _lacks(found) if inspect.isclass(found) else ""
    if lacking:
        raise BadReferenceError(f"'{use}' is not an autonomy: it has no method '{lacking}'")
    try:
        inspect.signature(found).bind(goal={}, parameters={}, seed=0)
    except (TypeError, ValueError) as error:
        wanted = "(*, goal, parameters, seed)"
        raise BadReferenceError(f"'{use}' cannot be called with {wanted}: {error}") from error
    return cast("AutonomyFactory", found)


def _lacks(kind: object) -> str:
    """Return the first method that an autonomy class lacks; "" when it has all."""
    missing = [name for name in _METHODS if not callable(getattr(kind, name, None))]
    return missing[0] if missing else ""
