"""What a guard's process is told at its start, as values and as what travels; pure."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, cast

from safety.fence_plain import fence_of_plain, plain_fence
from safety.guard.contingency import ContingencyPlan
from safety.guard.events import GuardedVehicle, GuardSettings
from safety.guard.following import PaceSetup
from safety.guard.limits import SetpointLimits
from vehicles.autopilots.base import AutopilotName, Mode, Target
from vehicles.autopilots.registry import autopilot_named
from vehicles.links.conditions import LinkConditions

_LANDINGS = frozenset({Mode.LAND.value, Mode.RTL.value})


class CharterError(ValueError):
    """A charter that cannot be read; says why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Guarded:
    """A vehicle for a guard's process.

    link: its link string; empty for a free UDP port of loopback, at which a vehicle is going to
    be started. patient: a vehicle is going to be started at the link, too. gcs: link string of a
    ground station port ("udpout://127.0.0.1:14550"); empty for none. conditions: how frames fare
    between the guard and the vehicle, and where their signing key is. spares: link strings of more
    links to the vehicle, flown by when those before them fall silent.
    """

    vehicle: GuardedVehicle
    link: str = ""
    patient: bool = False
    gcs: str = ""
    spares: tuple[str, ...] = ()
    conditions: LinkConditions = field(default_factory=LinkConditions)


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardCharter:
    """All that a guard's process has to know.

    folder: of the run, where it writes its journal and each vehicle's .tlog; run: what people
    call the run. epoch_s: UTC at which the run clock was zero. token: what an operator's socket
    command has to bring; empty for none (the socket is its owner's alone). patience_s: how long
    after the orchestrator's end vehicles that can break nothing are given to come down. pace: of
    the scaled clock; None for the wall's.
    """

    run: str
    folder: str
    epoch_s: float
    vehicles: Mapping[str, Guarded]
    settings: GuardSettings = field(default_factory=GuardSettings)
    plan: ContingencyPlan = field(default_factory=ContingencyPlan)
    token: str = ""
    patience_s: float = 120.0
    pace: PaceSetup | None = None

    def plain(self) -> dict[str, Any]:
        """Return the charter in plain values, for `from_plain`."""
        return {
            "run": self.run,
            "folder": self.folder,
            "epoch_s": self.epoch_s,
            "token": self.token,
            "patience_s": self.patience_s,
            "pace": None if self.pace is None else asdict(self.pace),
            "vehicles": {name: _plain_guarded(one) for name, one in self.vehicles.items()},
            "settings": asdict(self.settings),
            "plan": {**asdict(self.plan), "landing": self.plan.landing.value},
        }

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> "GuardCharter":
        """Return the charter of plain values. Raises CharterError."""
        try:
            plan = dict(plain["plan"])
            plan["landing"] = _landing(plan["landing"])
            charter = cls(
                run=str(plain["run"]),
                folder=str(plain["folder"]),
                epoch_s=float(plain["epoch_s"]),
                token=str(plain["token"]),
                patience_s=float(plain["patience_s"]),
                pace=None if plain["pace"] is None else PaceSetup(**plain["pace"]),
                vehicles={name: _guarded(one) for name, one in plain["vehicles"].items()},
                settings=GuardSettings(**plain["settings"]),
                plan=ContingencyPlan(**plan),
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise CharterError(f"the charter cannot be read: {error!r}") from error
        if not charter.vehicles or not math.isfinite(charter.epoch_s):
            raise CharterError("a charter names vehicles, and when the run clock was zero")
        return charter


def _plain_guarded(guarded: Guarded) -> dict[str, Any]:
    vehicle = guarded.vehicle
    return {
        "link": guarded.link,
        "patient": guarded.patient,
        "gcs": guarded.gcs,
        "spares": list(guarded.spares),
        "conditions": guarded.conditions.plain(),
        "autopilot": vehicle.autopilot.name,
        "target": [vehicle.target.system, vehicle.target.component],
        "fence": None if vehicle.fence is None else plain_fence(vehicle.fence),
        "attached": vehicle.attached,
        "landing": vehicle.landing.value,
        "terminate": vehicle.terminate,
        "limits": None if vehicle.limits is None else asdict(vehicle.limits),
    }


def _guarded(plain: Mapping[str, Any]) -> Guarded:
    fence, limits = plain["fence"], plain["limits"]
    return Guarded(
        link=str(plain["link"]),
        patient=bool(plain["patient"]),
        gcs=str(plain["gcs"]),
        spares=tuple(str(one) for one in plain["spares"]),
        conditions=LinkConditions.from_plain(plain["conditions"]),
        vehicle=GuardedVehicle(
            autopilot=_autopilot(plain["autopilot"]),
            target=Target(*plain["target"]),
            fence=None if fence is None else fence_of_plain(fence),
            attached=bool(plain["attached"]),
            landing=_landing(plain["landing"]),
            terminate=bool(plain["terminate"]),
            gcs=bool(plain["gcs"]),
            limits=None if limits is None else SetpointLimits(**limits),
        ),
    )


def _autopilot(name: str) -> Any:
    try:
        return autopilot_named(cast("AutopilotName", name))
    except StopIteration as error:
        raise ValueError(f"autopilot {name!r} is not known") from error


def _landing(value: str) -> Literal[Mode.LAND, Mode.RTL]:
    if value not in _LANDINGS:
        raise ValueError(f"{value!r} is no way to land")
    return Mode.RTL if value == Mode.RTL.value else Mode.LAND
