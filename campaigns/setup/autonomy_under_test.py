"""The autonomy under test: found by name or reference, and built for a run."""

import importlib
import inspect
import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from campaigns.values.autonomy_limits import AutonomyLimits
from campaigns.values.references import BadReferenceError, is_reference, load_reference
from vehicles.autonomy import Autonomy, AutonomyFactory
from worlds.files.documents import closest

_METHODS = ("perceive", "act")


@dataclass(frozen=True, slots=True)
class ShippedAutonomy:
    """An autonomy that comes with the program. name: what `use` may name."""

    name: str
    summary: str
    factory: AutonomyFactory


@dataclass(frozen=True, slots=True)
class UnderTest:
    """The autonomy under test as a campaign configures it; picklable.

    use: as in the file; None for a program. folder: to which a file in `use` is relative, and in
    which a program runs. goal: what the autonomy receives of it. rate_hz: of its actions. program:
    command and arguments. limits: of memory and time.
    """

    use: str | None
    folder: Path
    rate_hz: float
    parameters: Mapping[str, object] = field(default_factory=dict)
    goal: Mapping[str, float | str] = field(default_factory=dict)
    program: tuple[str, ...] | None = None
    limits: AutonomyLimits = field(default_factory=AutonomyLimits)

    def build(self, seed: int) -> Autonomy:
        """Return a new autonomy under test for one vehicle of one run.

        Raises BadReferenceError when it cannot be found, and whatever its constructor raises.
        """
        if self.use is None:
            raise BadReferenceError("a program is started, not built")
        factory = find_autonomy(self.use, self.folder)
        return factory(goal=dict(self.goal), parameters=dict(self.parameters), seed=seed)


def find_autonomy(use: str, folder: Path) -> AutonomyFactory:
    """Return the class or function that `use` names. Raises BadReferenceError."""
    if is_reference(use):
        return _check_autonomy(load_reference(use, folder), use)
    shipped = {autonomy.name: autonomy.factory for autonomy in shipped_autonomies()}
    if use not in shipped:
        known = ", ".join(shipped)
        message = f"there is no autonomy '{use}' (there are {known}; or give file.py:Class)"
        raise BadReferenceError(message, closest(use, shipped))
    return shipped[use]


def shipped_autonomies() -> tuple[ShippedAutonomy, ...]:
    """Return the autonomies of campaigns.autonomies: public classes that perceive and act."""
    package = importlib.import_module("campaigns.autonomies")
    found: list[ShippedAutonomy] = []
    for info in sorted(pkgutil.iter_modules(package.__path__), key=lambda info: info.name):
        module = importlib.import_module(f"campaigns.autonomies.{info.name}")
        for name, value in sorted(vars(module).items()):
            own = inspect.isclass(value) and value.__module__ == module.__name__
            if own and not name.startswith("_") and _lacks(value) == "":
                summary = (inspect.getdoc(value) or "").partition("\n")[0]
                found.append(ShippedAutonomy(info.name, summary, value))
    return tuple(found)


def _check_autonomy(found: object, use: str) -> AutonomyFactory:
    """Return the autonomy's factory when it takes the arguments of an autonomy."""
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
