"""The embedded vehicle: a simulated quadrotor with an autopilot on one end of a MAVLink link."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol, Self

import numpy as np

from wil_campaign.foundation.tasks import SuppressedErrors
from wil_campaign.vehicles.embedded.autopilot.aircraft import EmulatedAircraft
from wil_campaign.vehicles.embedded.autopilot.emulated_autopilot import EmulatedAutopilot
from wil_campaign.vehicles.embedded.autopilot.flight.autopilot_state import EmulatedIdentity
from wil_campaign.vehicles.embedded.autopilot.services.message_hub import COMPONENT
from wil_campaign.vehicles.embedded.emulations import emulations
from wil_campaign.vehicles.embedded.physics.body import PHYSICS_HZ, FlyingBody
from wil_campaign.vehicles.embedded.physics.config import (
    ContactWorld,
    EmbeddedConfig,
    EventListener,
)
from wil_campaign.vehicles.embedded.physics.mocap_feed import NEVER, MotionCaptureFeed
from wil_campaign.vehicles.embedded.physics.motion_kernel import NO_LAW
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.poses.truth import STOPPED, Thrusts, TruthSample
from wil_campaign.vehicles.readings import PoseReading
from wil_campaign.worlds.geodesy import LocalFrame

_LISTENER = SuppressedErrors("a listener to a vehicle's truth")
_STEPS_PER_TICK = 2
_TURN_STEPS = 5
_MAX_STEPS_BEHIND = 250
"""When it is farther behind (the process was stopped), it skips the time instead of catching up."""

TruthCallback = Callable[[TruthSample], None]
MocapCallback = Callable[[PoseReading], None]


class MavlinkComponent(Protocol):
    """A MAVLink component beside the autopilot, at the same link (protocol). Times: run clock."""

    @property
    def component_id(self) -> int:
        """Return the component's MAVLink component id."""

    def tick(self, t_s: float) -> list[Any]:
        """Return the component's messages that are due."""

    def receive(self, message: Any, t_s: float) -> list[Any]:
        """Return the component's replies to a message of a client."""


class EmbeddedVehicle:
    """An embedded vehicle in this event loop, in virtual or wall time.

    As an async context manager it opens its end of the link and runs on the loop's timers until it
    is closed. `seed` determines all its randomness. Positions are in the world's local frame. When
    the physics diverges the vehicle stops sending, and closing it raises the PlantError.
    """

    def __init__(
        self,
        *,
        config: EmbeddedConfig,
        link: Link,
        seed: int,
        contact_world: ContactWorld | None = None,
    ) -> None:
        self.config = config
        self._link = link
        self._contact_world = contact_world
        self._body = FlyingBody(config=config, seed=seed, contact_world=contact_world)
        self._autopilot = build_autopilot(config, self._body)
        self._codec = MavlinkCodec(system_id=config.system_id, component_id=COMPONENT)
        self._mocap = MotionCaptureFeed(
            noise=config.profile.mocap,
            source=config.source,
            physics_hz=PHYSICS_HZ,
            rng=np.random.default_rng([seed, 1]),
        )
        self._truth_callbacks: list[tuple[int, TruthCallback]] = []
        self._sample_step = 0
        """The next step of which somebody takes a sample."""
        self._thrusts: Thrusts = STOPPED
        self._drift = 1.0 + config.profile.clock.drift_ppm * 1e-6
        self._t0_s = 0.0
        self._steps = 0
        self._boot_step = -round(config.running_s * PHYSICS_HZ)
        self._timer: asyncio.TimerHandle | None = None
        self._mocap_timer: asyncio.TimerHandle | None = None
        self._alive = False
        self._fault: Exception | None = None
        self._on_fault: Callable[[], None] | None = None
        self._on_sent: Callable[[float, Any], None] | None = None
        self._pass_sent: Callable[[Any], Any | None] | None = None
        self._components: list[tuple[MavlinkComponent, MavlinkCodec]] = []
        self._muted = False
        self._struck = False
        link.receive(self._on_bytes)

    @property
    def autopilot(self) -> EmulatedAutopilot[Any]:
        """Return the embedded vehicle's autopilot, for tests."""
        return self._autopilot

    @property
    def body(self) -> FlyingBody:
        """Return the embedded vehicle's body, for tests that look inside or break a motor."""
        return self._body

    def truth(self) -> TruthSample:
        """Return the embedded vehicle's true state now."""
        return self._body.sample(self._step_s(self._steps))

    def on_truth(self, callback: TruthCallback, rate_hz: float) -> None:
        """Call `callback` with the vehicle's truth; rate_hz: 250 Hz or an integer fraction."""
        self._truth_callbacks.append((max(1, round(PHYSICS_HZ / rate_hz)), callback))
        self._sample_step = 0

    def on_mocap(self, callback: MocapCallback) -> None:
        """Call `callback` with the vehicle's motion capture, faults included."""
        self._mocap.add(callback, step=self._steps)
        self._sample_step = 0

    def on_fault(self, callback: Callable[[], None]) -> None:
        """Call `callback` when the vehicle's physics fails."""
        self._on_fault = callback

    def on_sent(self, callback: Callable[[float, Any], None]) -> None:
        """Call `callback` with each MAVLink message that is sent, and seconds since boot."""
        self._on_sent = callback

    def add_component(self, component: MavlinkComponent) -> None:
        """Add a MAVLink component to the vehicle's link, with the vehicle's system id."""
        codec = MavlinkCodec(system_id=self.config.system_id, component_id=component.component_id)
        self._components.append((component, codec))

    def filter_sent(self, passing: Callable[[Any], Any | None]) -> None:
        """Send what `passing` returns for each MAVLink message of the autopilot; None drops it."""
        self._pass_sent = passing

    def notify(self, event: str, t_s: float) -> None:
        """Pass an event of the world to the vehicle's contact world."""
        if isinstance(self._contact_world, EventListener):
            self._contact_world.notify(event, t_s)

    def kill(self) -> None:
        """Stop the embedded vehicle at once and for good, as when its process dies."""
        self._alive = False
        for timer in (self._timer, self._mocap_timer):
            if timer is not None:
                timer.cancel()

    def mute(self, *, muted: bool) -> None:
        """Mute or unmute the vehicle: all bytes are dropped both ways; it continues to fly."""
        self._muted = muted

    def fail_motor(self, index: int, *, factor: float = 0.0) -> None:
        """Multiply the thrust of one motor (0 to 3, PX4's order) by this factor; 0 stops it."""
        self._body.fail_motor(index, factor=factor)

    async def __aenter__(self) -> Self:
        """Open the embedded vehicle's link and start its physics."""
        await self._link.__aenter__()
        self._loop = loop = asyncio.get_running_loop()
        self._t0_s = loop.time()
        self._alive = True
        self._timer = loop.call_at(self._step_s(_STEPS_PER_TICK), self._tick)
        return self

    async def __aexit__(self, *raised: object) -> None:
        """Stop the vehicle and close the link. Raises the error that stopped it, if any."""
        self.kill()
        await self._link.__aexit__(*raised)
        if self._fault is not None and not any(raised):
            raise self._fault

    def _step_s(self, step: int) -> float:
        return self._t0_s + step / PHYSICS_HZ

    def _tick(self) -> None:
        try:
            self._catch_up()
        except Exception as error:
            self._fault = error
            self.kill()
            if self._on_fault is not None:
                self._on_fault()
            raise
        if self._alive:
            due_s = self._step_s(self._steps + _STEPS_PER_TICK)
            self._timer = self._loop.call_at(due_s, self._tick)

    def _catch_up(self) -> None:
        """Step the embedded vehicle until the present, and send its messages."""
        now_s = self._loop.time()
        behind = round((now_s - self._t0_s) * PHYSICS_HZ) - self._steps
        if behind > _MAX_STEPS_BEHIND:
            self._t0_s += (behind - _STEPS_PER_TICK) / PHYSICS_HZ
            behind = _STEPS_PER_TICK
        for _ in range(behind):
            if not self._alive:
                return
            self._step()
        self._flush()
        for component, codec in self._components:
            self._send_of(codec, component.tick(now_s))
        timer = self._mocap_timer
        if (timer is None or timer.when() <= now_s) and self._mocap.next_due_s is not None:
            self._deliver_mocap()

    def _deliver_mocap(self) -> None:
        """Deliver arrived motion capture readings, each at its own time."""
        loop = self._loop
        now_s = loop.time()
        if self._mocap_timer is not None and self._mocap_timer.when() > now_s:
            return
        self._mocap.deliver(now_s)
        due_s = self._mocap.next_due_s
        self._mocap_timer = (
            loop.call_at(due_s, self._deliver_mocap) if due_s is not None and self._alive else None
        )

    def _step(self) -> None:
        self._steps = steps = self._steps + 1
        body, autopilot = self._body, self._autopilot
        t_s = self._t0_s + steps / PHYSICS_HZ
        turn = steps % _TURN_STEPS == 0
        # In a turn the autopilot may change how it flies, by the estimate of this step.
        body.step(self._thrusts, t_s, NO_LAW if turn else autopilot.flight.outer_steps())
        if body.contact is not None and not self._struck:
            self._struck = True
            autopilot.strike(body.contact)
        clock_s = (steps - self._boot_step) / PHYSICS_HZ * self._drift
        self._thrusts = autopilot.step(clock_s, turn=turn)
        if steps >= self._sample_step:
            self._give_samples(steps, t_s)

    def _give_samples(self, steps: int, t_s: float) -> None:
        """Give the samples of this step, and find the next step that has one."""
        sample, mocap, next_step = self._body.sample(t_s), self._mocap, NEVER
        for every, callback in self._truth_callbacks:
            past = steps % every
            if past == 0:
                with _LISTENER:  # its error must not stop the vehicle
                    callback(sample)
            next_step = min(next_step, steps - past + every)
        if mocap.next_step == steps:
            mocap.receive(sample)
        self._sample_step = min(next_step, mocap.next_step)

    def _on_bytes(self, data: bytes, t_s: float) -> None:
        if self._muted or not self._alive:
            return
        # Several steps are run at once: the clock of the last one may be 8 ms behind.
        arrived_s = (t_s - self._step_s(self._boot_step)) * self._drift
        for message in self._codec.parse(data):
            self._autopilot.handle(message, arrived_s)
            for component, codec in self._components:
                self._send_of(codec, component.receive(message, t_s))
        self._flush()
        if self._autopilot.reboot_requested:
            self._reboot()

    def _reboot(self) -> None:
        """Reboot the embedded vehicle's autopilot; its parameters are kept."""
        parameters = {name: self._autopilot.parameters[name] for name in self._autopilot.parameters}
        boot_unix_us = self.config.boot_unix_us
        if boot_unix_us is not None:
            since_boot_s = self._steps / PHYSICS_HZ + self.config.running_s
            boot_unix_us += round(since_boot_s * 1e6)
        config = replace(self.config, parameters=parameters, boot_unix_us=boot_unix_us)
        self._autopilot = build_autopilot(config, self._body)
        self._boot_step = self._steps
        self._thrusts = STOPPED

    def _flush(self) -> None:
        messages = self._autopilot.outbox.take()
        if messages and self._pass_sent is not None:
            messages = [one for one in map(self._pass_sent, messages) if one is not None]
        if messages and self._alive and not self._muted:
            if self._on_sent is not None:
                for message in messages:
                    self._on_sent((self._steps - self._boot_step) / PHYSICS_HZ, message)
            pack = self._codec.pack
            self._link.write(b"".join([pack(message) for message in messages]))

    def _send_of(self, codec: MavlinkCodec, messages: list[Any]) -> None:
        """Send messages of a component."""
        if messages and self._alive and not self._muted:
            self._link.write(b"".join([codec.pack(message) for message in messages]))


def build_autopilot(config: EmbeddedConfig, body: FlyingBody) -> EmulatedAutopilot[Any]:
    """Return the embedded vehicle's autopilot for a config."""
    world = LocalFrame(config.latitude_deg, config.longitude_deg, config.altitude_m)
    start = world.to_geodetic(config.start.position_ned_m)
    identity = EmulatedIdentity(
        system_id=config.system_id,
        uid=config.uid,
        uid2=config.uid2,
        origin=LocalFrame(start.latitude_deg, start.longitude_deg, start.altitude_m),
    )
    aircraft = EmulatedAircraft(
        identity=identity,
        airframe=config.airframe,
        dt_s=1.0 / PHYSICS_HZ,
        body=body,
        overrides=config.parameters,
        full_streams=config.full_streams,
    )
    autopilot = emulations()[config.autopilot](aircraft)
    autopilot.state.clock_offset_s = config.profile.clock.boot_offset_s
    if config.boot_unix_us is not None:
        autopilot.state.gps_unix_offset_us = config.boot_unix_us - autopilot.state.boot_us
    autopilot.never_ready = config.never_ready
    autopilot.refusal = config.refuse_arm
    return autopilot
