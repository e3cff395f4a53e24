"""What tests of the guard's core share: a pair in flight, and frames to send to it."""

from typing import Any

from wil_campaign.plugins.ardupilot.strategy import ArduCopter
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.commands import OperatorAction
from wil_campaign.safety.guard.core.events import GuardedVehicle, GuardSettings, ToVehicle
from wil_campaign.safety.guard.core.guard_core import GuardCore
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.vehicles.autopilots.autopilot import (
    Autopilot,
    FlightMode,
    MavlinkTarget,
    command_long,
)
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

FENCE = Fence.box(north_m=(-3, 5), east_m=(-3, 3), up_m=(-1, 6))
DRIVER = MavlinkCodec(system_id=245, component_id=190)
GCS = MavlinkCodec(system_id=255, component_id=190)


def setpoint(autopilot: Autopilot | None = None, system: int = 1) -> bytes:
    message = (autopilot or Px4()).velocity_setpoint(
        MavlinkTarget(system), t_boot_ms=0, velocity_ned_m_s=(1.0, 0.0, 0.0)
    )
    return DRIVER.pack(message)


def command(number: int, *parameters: float, codec: MavlinkCodec = DRIVER) -> bytes:
    return codec.pack(command_long(MavlinkTarget(1), number, *parameters))


def mode_command(mode: FlightMode, codec: MavlinkCodec = DRIVER) -> bytes:
    return codec.pack(Px4().set_mode(MavlinkTarget(1), mode))


def make_pair(
    fake_vehicle: Any,
    rig: Any,
    *,
    settings: GuardSettings | None = None,
    real: dict[str, Any] | None = None,
    **guarded: Any,
) -> Any:
    vehicles = {
        "real": fake_vehicle("real", Px4(), system=1, **(real or {})),
        "twin": fake_vehicle("twin", ArduCopter(), system=2),
    }
    core = GuardCore(
        vehicles={
            "real": GuardedVehicle(
                autopilot=Px4(),
                target=MavlinkTarget(1),
                fence=FENCE,
                **{"attached": True, **guarded},
            ),
            "twin": GuardedVehicle(autopilot=ArduCopter(), target=MavlinkTarget(2), fence=FENCE),
        },
        settings=settings,
    )
    made = rig(core, vehicles)
    made.fly(1.0)
    return made


def abort(rig: Any, who: str = "anna") -> None:
    rig.apply(rig.core.apply(OperatorAction(OperatorCommand("abort", who)), rig.t_s))


def to_orchestrator(rig: Any, name: str, data: bytes) -> tuple[bytes, ...]:
    outputs = rig.core.from_orchestrator(name, data, rig.t_s)
    rig.apply(outputs)
    return tuple(f for out in outputs if isinstance(out, ToVehicle) for f in out.frames)
