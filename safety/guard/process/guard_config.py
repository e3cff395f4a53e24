"""What a guard's process is given at its start, as values and as what travels; pure."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import msgspec

from wil_campaign.foundation.processes.codec import MessageCodec, ProcessMessageError
from wil_campaign.safety.fence.fence_values import fence_of_plain, plain_fence
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.contingency import ContingencyPlan
from wil_campaign.safety.guard.core.events import GuardedVehicle, GuardSettings
from wil_campaign.safety.guard.process.run_clock import PaceSetup
from wil_campaign.vehicles.autopilots.autopilot import Autopilot
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.links.link_conditions import (
    LinkConditions,
    LinkLayer,
    layer_of_plain,
)


class GuardConfigError(ValueError):
    """A guard config that cannot be read; says why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardedVehicleConfig:
    """A vehicle in the config of a guard process.

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
class GuardConfig:
    """The complete config of a guard process.

    folder: of the run, where it writes its log and each vehicle's .tlog; run: what people call the
    run. campaign: the folder of the campaign; empty for a run of none. epoch_s: UTC at which the
    run clock was zero. token: what an operator's socket command has to bring; empty for none (the
    socket is its owner's alone). patience_s: how long after the orchestrator's end vehicles that
    can break nothing are given to come down, and how long an orchestrator that says nothing is
    waited for once nothing flies. pace: of the scaled clock; None for the wall clock.
    """

    run: str
    folder: str
    epoch_s: float
    vehicles: Mapping[str, GuardedVehicleConfig]
    campaign: str = ""
    settings: GuardSettings = field(default_factory=GuardSettings)
    plan: ContingencyPlan = field(default_factory=ContingencyPlan)
    token: str = ""
    patience_s: float = 120.0
    pace: PaceSetup | None = None

    def packed(self) -> bytes:
        """Return the guard config as bytes for `unpacked`; signing keys stay in their files."""
        return _codec.encode(self)

    @classmethod
    def unpacked(cls, packed: bytes) -> "GuardConfig":
        """Return the guard config of `packed` bytes. Raises GuardConfigError."""
        try:
            guard_config = _codec.decode(packed)
        except ProcessMessageError as error:
            raise GuardConfigError(f"the guard's configuration cannot be read: {error}") from error
        if not guard_config.vehicles or not math.isfinite(guard_config.epoch_s):
            raise GuardConfigError(
                "the guard's configuration must name the vehicles and the origin of the run clock"
            )
        return guard_config


_codec: MessageCodec[GuardConfig] = MessageCodec(
    GuardConfig,
    plain={
        Fence: (plain_fence, fence_of_plain),
        Autopilot: (lambda autopilot: autopilot.name, autopilot_named),
        LinkLayer: (msgspec.to_builtins, layer_of_plain),
    },
)
