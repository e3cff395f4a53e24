"""What is put aboard the vehicles before they arm, and taken back when they have landed.

Parameters of the campaign, and a fence of the autopilot's own: the second line behind the guard's.
"""

import asyncio
from collections.abc import Callable, Mapping
from contextlib import AsyncExitStack

from campaigns.setup.vehicle_setups import FlownSetup
from orchestrator.run.vehicles.arming_record import ArmingRecord
from orchestrator.run.vehicles.onboard_fences import OnboardFences
from orchestrator.run.vehicles.preflight_checks import (
    ceiling_above_home_m,
    sets_failsafes,
    wanted_failsafes,
)
from orchestrator.run.vehicles.simulator_logs import flight_log
from orchestrator.state.parameter_backups import parameter_backup_folder
from orchestrator.state.run_setup import RunSetup
from orchestrator.state.run_state import RunState
from orchestrator.state.vehicle_context import VehicleContext
from vehicles.driver.onboard.fence_backup import restore_fence
from vehicles.driver.onboard.parameter_backup import ParameterValue
from vehicles.errors import VehicleError

Note = Callable[..., None]

_LOG_S = 300.0
"""How long a log may take: at 57.6 kbit/s a megabyte."""


class OnboardConfiguration:
    """Applies and restores the onboard configuration of a run's vehicles; fetches logs.

    record: takes each step; note: what else is worth recording. Only of attached vehicles anything
    is set back: the others end with the run.
    """

    def __init__(
        self,
        *,
        setup: RunSetup,
        contexts: tuple[VehicleContext, ...],
        run_state: RunState,
        record: ArmingRecord,
        note: Note,
    ) -> None:
        self._setup = setup
        self._contexts = contexts
        self._run_state = run_state
        self._record = record
        self._note = note
        self._stacks: dict[str, AsyncExitStack] = {}
        self._unbooted: dict[str, frozenset[str]] = {}
        self.fences = OnboardFences(setup=setup, contexts=contexts, note=note)

    @property
    def unbooted(self) -> Mapping[str, frozenset[str]]:
        """Return parameters that were changed in operation, by vehicle: some need a boot."""
        return self._unbooted

    async def put(self, context: VehicleContext) -> None:
        """Apply a ready vehicle's parameters and fence, each read back. Raises VehicleError."""
        vehicle = self._setup.flown(context.name)
        stack = self._stacks[context.name] = AsyncExitStack()
        with self._record.step("parameters", context.name) as said:
            said(await self._put_parameters(context, vehicle, stack))
        with self._record.step("fence", context.name) as said:
            said(await self.fences.put(context, stack))

    async def restore(self) -> None:
        """Restore the onboard configuration; a failure is decisive, for it stays so."""
        await asyncio.gather(*(self._undo(name, one) for name, one in self._stacks.items()))
        self._stacks.clear()

    async def fetch_logs(self) -> None:
        """Fetch each vehicle's newest log into the run's folder; failures are noted."""
        if self._setup.campaign.record.vehicle_logs:
            await asyncio.gather(*map(self._fetch_log, self._contexts))

    async def _put_parameters(
        self, context: VehicleContext, vehicle: FlownSetup, stack: AsyncExitStack
    ) -> str:
        """Apply a vehicle's parameters, and say which."""
        parameters = context.driver.parameters
        if vehicle.attached is None:
            # All were born with the campaign's, and end with the run; a simulator has to show that
            # it was.
            given = {} if vehicle.embedded else vehicle.params
            values = {**await self._failsafes(context, vehicle), **given}
            for name, value in values.items():
                await parameters.set(name, value)
            return ", ".join(f"{name} {value:g}" for name, value in values.items()) or "none set"
        journal = parameter_backup_folder()
        restored = await parameters.restore_backups(journal)
        for change in restored.restored:
            self._note("parameter", vehicle=context.name, name=change.name, value=change.before)
        fences = context.driver.onboard.fences
        if await restore_fence(journal, fences=fences, vehicle=parameters.vehicle):
            self._note("fence_given_back", vehicle=context.name)
        changes = {**await self._failsafes(context, vehicle), **vehicle.params}
        changed = parameters.changed(changes, backup_folder=journal)
        await stack.enter_async_context(changed)
        moved = tuple(one for one in changed.changes if one.before != one.wanted)
        names = (one.name for one in (*restored.restored, *moved))
        self._unbooted[context.name] = frozenset(names)
        said = [f"{one.name} {one.wanted:g} (was {one.before:g})" for one in moved]
        return ", ".join(said) or "none changed"

    async def _failsafes(
        self, context: VehicleContext, vehicle: FlownSetup
    ) -> Mapping[str, ParameterValue]:
        """Return the autopilot's failsafe parameters to apply, except the campaign's.

        By default what is attached is not touched; its failsafes are looked at by the preflight.
        """
        if not sets_failsafes(self._setup, vehicle):
            return {}
        ceiling_m = ceiling_above_home_m(self._setup, vehicle)
        wanted = await wanted_failsafes(
            context.driver.identity.autopilot, context.driver.parameters, ceiling_m=ceiling_m
        )
        return {name: value for name, value in wanted.items() if name not in vehicle.params}

    async def _undo(self, name: str, stack: AsyncExitStack) -> None:
        attached = self._setup.flown(name).attached is not None
        try:
            await stack.aclose()
            if attached:
                self._record.restored(name, ok=True)
        except VehicleError as error:
            self._record.restored(name, ok=False)
            said = f"{name} keeps the onboard configuration of this run: {error}"
            if name in self._run_state.dropped_out:
                self._note("parameter", vehicle=name, text=said)
            else:
                self._run_state.decide("ERROR", said)

    async def _fetch_log(self, context: VehicleContext) -> None:
        logs, folder = context.driver.onboard.logs, self._setup.order.folder
        # What we launched writes them here; PX4's take longer over MAVLink than the flight did.
        written = flight_log(folder / f"{context.name}-sitl")
        if written is not None:
            self._note("log", vehicle=context.name, text=str(written.relative_to(folder)))
            return
        try:
            async with asyncio.timeout(_LOG_S):
                entries = await logs.list()
                if not entries:
                    self._note("log", vehicle=context.name, text="it has no log")
                    return
                file = await logs.fetch(entries[-1], folder, name=context.name)
        except TimeoutError:
            self._note("log", vehicle=context.name, text=f"not fetched within {_LOG_S:g} s")
        except VehicleError as error:
            self._note("log", vehicle=context.name, text=str(error))
        else:
            self._note("log", vehicle=context.name, text=file.name)
