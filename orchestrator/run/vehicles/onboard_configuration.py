"""Onboard configuration: parameters and fences, applied before arming, restored after landing.

The onboard fence is the autopilot's own: the second line behind the guard's.

The log of a launched simulator is found in its folder, so that no download is needed.
"""

import asyncio
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

from wil_campaign.campaigns.setup.vehicle_setups import FlownSetup
from wil_campaign.foundation.files.paths import file_sizes
from wil_campaign.orchestrator.run.vehicles.arming_record import ArmingRecord
from wil_campaign.orchestrator.run.vehicles.onboard_fences import OnboardFences
from wil_campaign.orchestrator.run.vehicles.preflight_checks import (
    ceiling_above_home_m,
    sets_failsafes,
    wanted_failsafes,
)
from wil_campaign.orchestrator.run.vehicles.restoration import Restoration
from wil_campaign.orchestrator.state.parameter_backups import parameter_backup_folder
from wil_campaign.orchestrator.state.run_setup import RunSetup, place_of_vehicle
from wil_campaign.orchestrator.state.run_state import FlightError, RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.vehicles.driver.onboard.fence_backup import restore_fence
from wil_campaign.vehicles.driver.onboard.parameter_backup import ParameterValue
from wil_campaign.vehicles.errors import VehicleError

_SUFFIXES = frozenset({".bin", ".ulg"})
_NO_LOG = "eeprom.bin"
"""The parameters of ArduPilot, no log."""


def flight_log(folder: Path) -> Path | None:
    """Return the log of a simulator's flight, the largest below its folder; None if all are empty.

    ArduCopter begins another one, almost empty, as soon as it has landed.
    """
    sizes = file_sizes(folder)
    logs = [file for file in sizes if file.suffix.lower() in _SUFFIXES and file.name != _NO_LOG]
    return max((file for file in logs if sizes[file] > 0), key=sizes.__getitem__, default=None)


Note = Callable[..., None]

_LOG_S = 300.0
"""How long the download of a log may take: about 1 MB at 57.6 kbit/s."""


class OnboardConfiguration:
    """Applies and restores the onboard configuration of a run's vehicles; fetches logs.

    record: of the steps before arming; note: records other events. Only attached vehicles are
    restored: the others end with the run.
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
        self._restorations: dict[str, Restoration] = {}
        self._unbooted: dict[str, frozenset[str]] = {}
        self.fences = OnboardFences(setup=setup, contexts=contexts, note=note)

    @property
    def unbooted(self) -> Mapping[str, frozenset[str]]:
        """Return the parameters changed since boot, by vehicle: some take effect after a reboot."""
        return self._unbooted

    async def apply(self, context: VehicleContext) -> None:
        """Apply a ready vehicle's parameters and fence, each read back.

        Raises VehicleError, and FlightError for another vehicle than was cleared to fly.
        """
        vehicle = self._setup.flown(context.name)
        self._require_cleared(context, vehicle)
        restoration = self._restorations[context.name] = Restoration()
        with self._record.step("parameters", context.name) as note:
            note(await self._apply_parameters(context, vehicle, restoration))
        with self._record.step("fence", context.name) as note:
            note(await self.fences.upload(context, restoration))

    def _require_cleared(self, context: VehicleContext, vehicle: FlownSetup) -> None:
        """Refuse a vehicle in the place of the one that was cleared to fly. Raises FlightError.

        A person has consented to arm that one, and hardware would be flown as a simulation.
        """
        place, uid = place_of_vehicle(vehicle), context.driver.identity.uid
        if (cleared := self._setup.order.uids.get(place, uid)) != uid:
            raise FlightError(
                f"another vehicle is there as {place}: its uid is {uid}, and {cleared} was cleared "
                "to fly; start again to fly this one"
            )

    async def restore(self, *, at_rest: Collection[str]) -> None:
        """Restore the onboard configuration of the vehicles that are confirmed to be at rest.

        In the air it would change the failsafe or the return that is under way: the other vehicles
        keep it until the next start. That, and a failure, decides the run as ERROR.
        """
        results = await asyncio.gather(
            *(
                self._restore_vehicle(name, restoration, at_rest=name in at_rest)
                for name, restoration in self._restorations.items()
            ),
            return_exceptions=True,
        )
        self._restorations.clear()
        for result in results:
            if result is not None:
                raise result

    async def fetch_logs(self) -> None:
        """Fetch each vehicle's newest log into the run's folder; failures are noted."""
        if self._setup.case.record.vehicle_logs:
            fetches = map(self._fetch_log, self._contexts)
            for result in await asyncio.gather(*fetches, return_exceptions=True):
                if result is not None:
                    raise result

    async def _apply_parameters(
        self, context: VehicleContext, vehicle: FlownSetup, restoration: Restoration
    ) -> str:
        """Apply a vehicle's parameters; return in words which."""
        parameters = context.driver.parameters
        if vehicle.attached is None:
            # Simulations start with the campaign's parameters and end with the run; a simulator is
            # set again and read back, to be sure.
            campaign_values = {} if vehicle.embedded else vehicle.params
            values = {**await self._failsafes(context, vehicle), **campaign_values}
            for name, value in values.items():
                await parameters.set(name, value)
            return ", ".join(f"{name} {value:g}" for name, value in values.items()) or "none set"
        backups = parameter_backup_folder()
        restored = await parameters.restore_backups(backups)
        for change in restored.restored:
            self._note("parameter", vehicle=context.name, name=change.name, value=change.before)
        fences = context.driver.onboard.fences
        if await restore_fence(backups, fences=fences, vehicle=parameters.vehicle):
            self._note("fence_given_back", vehicle=context.name)
        changes = {**await self._failsafes(context, vehicle), **vehicle.params}
        changed = parameters.changed(changes, backup_folder=backups)
        await restoration.enter(changed)
        moved = tuple(one for one in changed.changes if one.before != one.wanted)
        names = (one.name for one in (*restored.restored, *moved))
        self._unbooted[context.name] = frozenset(names)
        texts = [f"{one.name} {one.wanted:g} (was {one.before:g})" for one in moved]
        return ", ".join(texts) or "none changed"

    async def _failsafes(
        self, context: VehicleContext, vehicle: FlownSetup
    ) -> Mapping[str, ParameterValue]:
        """Return the autopilot's failsafe parameters to apply, except the campaign's.

        By default those of attached vehicles are not changed, only checked by the preflight.
        """
        if not sets_failsafes(self._setup, vehicle):
            return {}
        ceiling_m = ceiling_above_home_m(self._setup, vehicle)
        wanted = await wanted_failsafes(
            context.driver.identity.autopilot, context.driver.parameters, ceiling_m=ceiling_m
        )
        return {name: value for name, value in wanted.items() if name not in vehicle.params}

    async def _restore_vehicle(self, name: str, restoration: Restoration, *, at_rest: bool) -> None:
        why = ""
        if at_rest:
            try:
                await restoration.restore()
            except VehicleError as error:
                why = str(error)
        elif restoration.leave():
            why = (
                "the guard does not confirm that it is disarmed, and in the air nothing is "
                f"restored; the next start restores it, from {parameter_backup_folder()}"
            )
        if self._setup.flown(name).attached is not None:
            self._record.restored(name, ok=not why)
        if why:
            reason = f"{name} still has the onboard configuration of this run: {why}"
            if name in self._run_state.dropped_out:
                self._note("parameter", vehicle=name, text=reason)
            else:
                self._run_state.decide("ERROR", reason)

    async def _fetch_log(self, context: VehicleContext) -> None:
        """Fetch a vehicle's newest log; note its file, or why it was not fetched."""
        folder = self._setup.order.folder
        try:
            text = await _fetch_newest_log(context, folder)
        except TimeoutError:
            text = f"not fetched within {_LOG_S:g} s"
        except VehicleError as error:
            text = str(error)
        except OSError as error:
            text = f"the log cannot be fetched to {folder}: {error.strerror or error}"
        self._note("log", vehicle=context.name, text=text)


async def _fetch_newest_log(context: VehicleContext, folder: Path) -> str:
    """Fetch a vehicle's newest log that is not empty; return its file's path in the folder.

    An autopilot may list logs of 0 bytes behind that of the flight: begun, and not written yet.
    Returns in words that there is no log. Raises VehicleError, TimeoutError, OSError.
    """
    # A launched simulator writes its log here; over MAVLink it would take longer than the run.
    written = flight_log(folder / f"{context.name}-sitl")
    if written is not None:
        return str(written.relative_to(folder))
    logs = context.driver.onboard.logs
    async with asyncio.timeout(_LOG_S):
        entries = await logs.list()
        if not entries:
            return "the vehicle has no log"
        newest = next((entry for entry in reversed(entries) if entry.size_bytes > 0), None)
        if newest is None:
            return f"all {len(entries)} logs of the vehicle are empty"
        file = await logs.fetch(newest, folder, name=context.name)
    newer = len(entries) - 1 - entries.index(newest)
    return f"{file.name} (newer logs, all empty: {newer})" if newer else file.name
