"""Whatever is done to the guard, in whatever order: what must always hold."""

from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from wil_campaign.plugins.ardupilot.strategy import ArduCopter
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.commands import BringDown, OperatorAction, OrchestratorAlive
from wil_campaign.safety.guard.core.contingency import ContingencyPhase
from wil_campaign.safety.guard.core.events import GuardedVehicle, ToVehicle
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
STRATEGIES: dict[str, Autopilot] = {"real": Px4(), "twin": ArduCopter()}
TARGETS = {"real": MavlinkTarget(1), "twin": MavlinkTarget(2)}
names = st.sampled_from(["real", "twin"])
STEERING = frozenset({"SET_POSITION_TARGET_LOCAL_NED", "COMMAND_LONG", "SET_MODE"})


class Guarded(RuleBasedStateMachine):
    """Flies a pair and does to it, and to the guard, what comes to mind."""

    make_vehicle: Any
    make_rig: Any

    def __init__(self) -> None:
        super().__init__()
        self.driver = MavlinkCodec(system_id=245, component_id=190)
        self.gcs = MavlinkCodec(system_id=255, component_id=190)
        vehicles = {
            name: self.make_vehicle(name, STRATEGIES[name], system=TARGETS[name].system)
            for name in ("real", "twin")
        }
        core = GuardCore(
            vehicles={
                "real": GuardedVehicle(
                    autopilot=STRATEGIES["real"], target=TARGETS["real"], fence=FENCE, attached=True
                ),
                "twin": GuardedVehicle(
                    autopilot=STRATEGIES["twin"], target=TARGETS["twin"], fence=FENCE
                ),
            }
        )
        self.rig = self.make_rig(core, vehicles)
        self.rig.fly(1.0)
        self.first_cause: str | None = None
        self.passed_after_latch: list[str] = []

    def send(self, name: str, message: Any) -> None:
        latched = self.rig.core.latched is not None or self.rig.core.paused
        outputs = self.rig.core.from_orchestrator(name, self.driver.pack(message), self.rig.t_s)
        if latched and any(isinstance(out, ToVehicle) for out in outputs):
            self.passed_after_latch.append(message.get_type())
        self.rig.apply(outputs)

    @rule(seconds=st.sampled_from([0.05, 0.3, 1.0, 4.0]))
    def fly(self, seconds: float) -> None:
        self.rig.fly(seconds)

    @rule(name=names)
    def setpoint(self, name: str) -> None:
        message = STRATEGIES[name].velocity_setpoint(
            TARGETS[name], t_boot_ms=0, velocity_ned_m_s=(1, 0, 0)
        )
        self.send(name, message)

    @rule(
        name=names,
        mode=st.sampled_from([FlightMode.GUIDED, FlightMode.HOLD, FlightMode.LAND, FlightMode.RTL]),
    )
    def orchestrator_asks_for_a_mode(self, name: str, mode: FlightMode) -> None:
        self.send(name, STRATEGIES[name].set_mode(TARGETS[name], mode))

    @rule(name=names, arm=st.booleans())
    def orchestrator_arms(self, name: str, arm: bool) -> None:
        self.send(name, command_long(TARGETS[name], 400, float(arm)))

    @rule(name=names)
    def orchestrator_cuts_motors(self, name: str) -> None:
        if name == "real":
            self.send(name, command_long(TARGETS[name], 185, 1.0))

    @rule(kind=st.sampled_from(["abort", "hold", "resume"]))
    def operator(self, kind: Any) -> None:
        self.rig.apply(
            self.rig.core.apply(OperatorAction(OperatorCommand(kind, "anna")), self.rig.t_s)
        )

    @rule()
    def bring_down(self) -> None:
        self.rig.apply(self.rig.core.apply(BringDown("because"), self.rig.t_s))

    @rule()
    def alive(self) -> None:
        self.rig.apply(self.rig.core.apply(OrchestratorAlive(), self.rig.t_s))

    @rule(name=names, speed=st.sampled_from([-2.0, 0.0, 0.7, 4.0]))
    def drift(self, name: str, speed: float) -> None:
        self.rig.vehicles[name].north_m_s = speed

    @rule(
        name=names,
        mode=st.sampled_from(
            [FlightMode.PILOT, FlightMode.RTL, FlightMode.LAND, FlightMode.GUIDED]
        ),
    )
    def mode_changes_by_itself(self, name: str, mode: FlightMode) -> None:
        self.rig.vehicles[name].mode = mode

    @rule(name=names, mute=st.booleans(), deaf=st.booleans(), stuck=st.booleans())
    def trouble(self, name: str, mute: bool, deaf: bool, stuck: bool) -> None:
        vehicle = self.rig.vehicles[name]
        vehicle.mute, vehicle.deaf, vehicle.stuck = mute, deaf, stuck

    @rule(name=names, data=st.binary(max_size=80))
    def garbage(self, name: str, data: bytes) -> None:
        self.rig.apply(self.rig.core.from_vehicle(name, data, self.rig.t_s))
        self.rig.apply(self.rig.core.from_orchestrator(name, data, self.rig.t_s))

    @precondition(lambda self: self.rig.t_s > 3.0)
    @rule(name=names)
    def ground_station_asks_for_land(self, name: str) -> None:
        message = STRATEGIES[name].set_mode(TARGETS[name], FlightMode.LAND)
        self.rig.apply(self.rig.core.from_gcs(name, self.gcs.pack(message), self.rig.t_s))

    @invariant()
    def the_latch_never_opens(self) -> None:
        if self.first_cause is None:
            self.first_cause = self.rig.core.latched
        assert self.rig.core.latched == self.first_cause

    @invariant()
    def nothing_that_steers_passes_after_it(self) -> None:
        assert not STEERING.intersection(self.passed_after_latch)

    @invariant()
    def an_attached_vehicle_s_motors_are_never_cut(self) -> None:
        assert "TERMINATE" not in self.rig.vehicles["real"].words()

    def settled(self) -> bool:
        return all(
            phase in {ContingencyPhase.DOWN, ContingencyPhase.PILOT}
            for phase in self.rig.core.phases.values()
        )

    def teardown(self) -> None:
        """From any state: both come down, once they hear and sink again."""
        rig = self.rig
        since_s = rig.t_s
        rig.apply(rig.core.apply(OperatorAction(OperatorCommand("abort", "anna")), rig.t_s))
        for vehicle in rig.vehicles.values():
            vehicle.mute = vehicle.deaf = vehicle.stuck = False
        while rig.t_s < since_s + 150.0 and not self.settled():
            rig.fly(1.0)
        for name, phase in rig.core.phases.items():
            vehicle = rig.vehicles[name]
            if phase is not ContingencyPhase.PILOT:
                assert not vehicle.armed, (name, phase)
        self.nothing_that_steers_passes_after_it()
        self.an_attached_vehicle_s_motors_are_never_cut()
        super().teardown()


def test_the_guard_keeps_its_rules_in_any_order_of_events(fake_vehicle: Any, rig: Any) -> None:
    Guarded.make_vehicle, Guarded.make_rig = fake_vehicle, rig
    run_state_machine_as_test(
        Guarded,
        settings=settings(max_examples=60, stateful_step_count=25, deadline=None, derandomize=True),
    )
