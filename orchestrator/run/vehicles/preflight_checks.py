"""Preflight of a run: gathers the values for the checks of `wil_campaign.safety.preflight`."""

import asyncio
import itertools
import math
import shutil
from collections.abc import Callable, Iterable
from dataclasses import asdict
from functools import partial
from pathlib import Path

from wil_campaign.campaigns.setup.vehicle_setups import FlownSetup
from wil_campaign.campaigns.values.wanted_firmware import fits_firmware
from wil_campaign.orchestrator.run.vehicles.encounter_items import distance_m, encounter_items
from wil_campaign.orchestrator.run.vehicles.firmware_record import firmware_of
from wil_campaign.orchestrator.run.vehicles.return_checks import return_faults
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import FlightError
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.preflight import (
    PreflightItem,
    at_least_item,
    at_most_item,
    earth_item,
    faults_item,
    firmware_item,
    gps_items,
    ground_truth_item,
    home_item,
    items_with_overrides,
    other_sender_item,
    pair_item,
    permitted_item,
    refused_items_text,
)
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.driver.onboard.parameter_backup import ParameterValue
from wil_campaign.vehicles.driver.onboard.parameters import OnboardParameters
from wil_campaign.vehicles.errors import ParameterError
from wil_campaign.vehicles.mavlink.names import message_name
from wil_campaign.worlds.frames import Vec3, norm, rotate, subtract

Note = Callable[..., None]

_FRESH_S = 0.5
"""How old the newest pose may be: twenty periods of the slowest requested telemetry."""
_FIRST_POSE_S = 5.0
"""How long to wait for the first poses of a ready vehicle, also on a busy computer."""
_FIX_WITHIN_S = 3.0
_RATE_OVER_S = 1.0
_TILT_DEG = 10.0
"""As an attitude is judged in flight: five times what both sources state."""
_DOWN: Vec3 = (0.0, 0.0, 1.0)
_POLL_S = 0.02
_MEGABYTE = 1e6
_OF_CEILING = 0.75
"""Return altitude beneath a low ceiling, as a share of it: a quarter is left for overshoot."""


class PreflightChecks:
    """Runs the preflight checks before arming. items: the results; note: records each of them."""

    def __init__(self, *, setup: RunSetup, note: Note) -> None:
        self._setup = setup
        self._note = note
        self.items: tuple[PreflightItem, ...] = ()

    async def check(
        self, contexts: tuple[VehicleContext, ...], actors: tuple[VehicleContext, ...] = ()
    ) -> str:
        """Check all vehicles before arming; return in words how many checks there were.

        contexts: of the pair; checked again, those that stand. Raises FlightError with every reason
        against arming.
        """
        wanted = self._setup.case.preflight
        items = [disk_item(self._setup.order.folder, wanted.min_disk_mb)]
        flown = (*contexts, *actors)
        await _await_positions(flown)
        for context in flown:
            items += await self._vehicle(context)
        items += self._pair(contexts)
        items += encounter_items(self._setup, flown)
        items += itertools.starmap(permitted_item, self._setup.case.permits.items())
        checked = items_with_overrides(items, wanted.override)
        again = {(item.check, item.vehicle) for item in checked}
        left = (item for item in self.items if (item.check, item.vehicle) not in again)
        self.items = (*left, *checked)
        for item in checked:
            self._note("preflight", **asdict(item))
        if reasons := refused_items_text(checked):
            raise FlightError(f"preflight: {reasons}{_advice(checked)}")
        overridden = sum(item.outcome == "overridden" for item in checked)
        return f"{len(checked)} checks" + (f", {overridden} overridden" if overridden else "")

    async def _vehicle(self, context: VehicleContext) -> Iterable[PreflightItem]:
        setup, name = self._setup, context.name
        wanted, vehicle = setup.case.preflight, setup.flown(name)
        state, fence = context.driver.state, setup.case.fences.get(vehicle.name)
        battery = None if state.battery is None else state.battery.remaining
        position = _position(context)
        uncertainty_s = context.driver.clock.uncertainty_s
        items = [
            *await self._failsafes(context, vehicle),
            *await self._least_takeoff(context),
            at_least_item("battery", name, battery, wanted.min_battery, unit="", what="its charge"),
            faults_item("estimator", name, state.faults),
            _position_item(context, position, wanted.start_tolerance_m),
            *(other_sender_item(name, text) for text in context.driver.others),
            *await self._source(context),
            at_most_item(
                "clock",
                name,
                uncertainty_s,
                wanted.max_clock_error_s,
                unit="s",
                what="the uncertainty of its clock",
            ),
        ]
        if fence is not None:
            items.append(home_item(name, fence, position, setup.case.guarding.keep_m))
            items += self._place(context)
        context.driver.parameter_digest.settle()
        if (version := setup.case.firmware.get(name)) is not None:
            identity = context.driver.identity
            found = fits_firmware(version, identity.version_text, identity.git_hash)
            flown = firmware_of(context, setup).release
            items.append(firmware_item(name, flown, fits=found, wanted=version))
        return items

    def _place(self, context: VehicleContext) -> Iterable[PreflightItem]:
        """Return the preflight item of an attached vehicle's place, where its fence is on Earth.

        Its world begins where it stands, and would shift that fence.
        """
        name, case = context.name, self._setup.case
        vehicle = self._setup.flown(name)
        if name not in case.fences_on_earth or vehicle.attached is None:
            return ()
        if name in case.vehicles and self._setup.vehicle(name).anchor == "mocap":
            return ()
        start = case.world.frame.to_geodetic(vehicle.start.position_ned_m)
        place_deg = start.latitude_deg, start.longitude_deg
        anchor = context.driver.anchor
        turned_deg = 0.0 if anchor is None else math.degrees(anchor.turn_rad)
        off_m = distance_m(context.driver.place_deg, place_deg)
        return (earth_item(name, off_m, turned_deg, place_deg),)

    async def _source(self, context: VehicleContext) -> Iterable[PreflightItem]:
        """Return the preflight items of a vehicle's pose source: motion capture, or truth and GPS.

        A simulated vehicle flies by its estimate, also where it is judged by its truth.
        """
        wanted, name = self._setup.case.preflight, context.name
        if context.pose_source == "mocap":
            age_s = context.poses.at(asyncio.get_running_loop().time()).gap_s
            rate_hz = context.poses.rate_hz(_RATE_OVER_S)
            age = "the age of its motion capture pose"
            rate = "the rate of its motion capture poses"
            return (
                at_most_item("mocap", name, age_s, _FRESH_S, unit="s", what=age),
                at_least_item("mocap", name, rate_hz, wanted.min_mocap_hz, unit="Hz", what=rate),
                *_tilt_items(context),
            )
        is_judged_by_truth = context.pose_source == "simulator"
        has_truth = is_judged_by_truth and self._setup.flown(name).requests_truth
        truth = (self._truth_item(context),) if has_truth else ()
        if wanted.gps is None or not self._setup.flown(name).has_gps:
            return truth
        fix = await context.driver.onboard.gps_receiver.fix(_FIX_WITHIN_S)
        gps = gps_items(
            name,
            None if fix is None else (fix.kind, fix.satellites, fix.hdop),
            min_satellites=wanted.gps.min_satellites,
            max_hdop=wanted.gps.max_hdop,
        )
        return (*truth, *gps)

    def _truth_item(self, context: VehicleContext) -> PreflightItem:
        # Not the rate of the poses: these begin with the anchor, which may be new.
        now_s = asyncio.get_running_loop().time()
        return ground_truth_item(
            context.name,
            context.driver.truth.rate_hz(now_s, fresh_s=_FRESH_S),
            wanted_hz=self._setup.flown(context.name).rates.position_hz,
            message=message_name(
                autopilot_named(context.driver.identity.autopilot).truth_message_id
            ),
            refused=context.driver.truth.refused,
        )

    async def _failsafes(
        self, context: VehicleContext, vehicle: FlownSetup
    ) -> Iterable[PreflightItem]:
        failsafes = autopilot_named(context.driver.identity.autopilot).failsafes
        parameters = context.driver.parameters
        values: dict[str, float] = {}
        for rule in failsafes.rules:
            if rule.counts(values):
                values |= await first_known_parameter(parameters, rule.names)
        names = tuple(parameter.name for parameter in failsafes.return_altitudes)
        ceiling_m = ceiling_above_home_m(self._setup, vehicle)
        faults = [*failsafes.unsound(values, pace=vehicle.launch_pace or 1.0)]
        fence = self._setup.case.fences.get(vehicle.name)
        if fence is not None:
            known = partial(first_known_parameter, parameters)
            faults += await return_faults(context, fence, values, known)
        items = [faults_item("failsafe", context.name, faults)]
        if ceiling_m is not None:
            altitude_m = failsafes.return_altitude_m(await first_known_parameter(parameters, names))
            what = "its RTL altitude"
            items.append(
                at_most_item(
                    "return_altitude", context.name, altitude_m, ceiling_m, unit="m", what=what
                )
            )
        return items

    async def _least_takeoff(self, context: VehicleContext) -> Iterable[PreflightItem]:
        """Return the preflight item of the height to which the autopilot climbs at least."""
        identity = context.driver.identity
        autopilot = autopilot_named(identity.autopilot)
        name = autopilot.least_takeoff_parameter(identity.version)
        pair = {vehicle.name: vehicle for vehicle in self._setup.vehicles}
        if name is None or context.name not in pair:
            return ()
        known = await first_known_parameter(context.driver.parameters, [name])
        height_m = self._setup.height_m(pair[context.name])
        what = f"its {name}, to which {autopilot.label} {identity.version_text} climbs at least,"
        # A float of 4 bytes: 1.2 is 1.2000000477.
        least_m = round(known[name], 3) if known else None
        return (
            at_most_item("takeoff_height", context.name, least_m, height_m, unit="m", what=what),
        )

    def _pair(self, contexts: tuple[VehicleContext, ...]) -> Iterable[PreflightItem]:
        if len(contexts) < 2:
            return ()
        real, twin = [_from_start(context, _position(context)) for context in contexts]
        return (pair_item(real, twin, self._setup.case.preflight.pair_tolerance_m),)


async def first_known_parameter(
    parameters: OnboardParameters, names: Iterable[str]
) -> dict[str, float]:
    """Return name and value of the first parameter that the firmware knows; empty for none."""
    for name in names:
        try:
            return {name: await parameters.get(name)}
        except ParameterError:
            continue
    return {}


async def wanted_failsafes(
    autopilot: str, parameters: OnboardParameters, *, ceiling_m: float | None
) -> dict[str, ParameterValue]:
    """Return the failsafe parameters that preflight demands, by the firmware's names.

    ceiling_m: of the fence, above home; a higher return altitude is lowered beneath it.
    """
    wanted: dict[str, ParameterValue] = {}
    for rule in autopilot_named(autopilot).failsafes.rules:
        if rule.wanted is not None or rule.forbidden:  # The others are checked only.
            for name, value in (await first_known_parameter(parameters, rule.names)).items():
                instead = rule.wanted_instead(value)
                if instead is not None:
                    wanted[name] = instead
    if ceiling_m is not None:
        wanted |= await lower_return_parameters(autopilot, parameters, ceiling_m=ceiling_m)
    return wanted


async def lower_return_parameters(
    autopilot: str, parameters: OnboardParameters, *, ceiling_m: float
) -> dict[str, ParameterValue]:
    """Return the parameters that make an autopilot return beneath a ceiling; empty if set."""
    for parameter in autopilot_named(autopilot).failsafes.return_altitudes:
        for name, value in (await first_known_parameter(parameters, [parameter.name])).items():
            if value * parameter.metres <= ceiling_m:
                return {}
            beneath = ceiling_m * _OF_CEILING / parameter.metres
            # Centimetres in whole numbers: 1.8 m is 179.999... of them in floats.
            return {name: int(round(beneath, 6)) if isinstance(value, int) else beneath}
    return {}


def sets_failsafes(setup: RunSetup, vehicle: FlownSetup) -> bool:
    """Return whether the failsafes of a vehicle are set; by default not those of attached ones.

    Failsafes that are not set are checked.
    """
    how = setup.case.preflight.failsafe
    return how == "set" or (how is None and vehicle.attached is None)


def ceiling_above_home_m(
    setup: RunSetup, vehicle: FlownSetup, changed: Fence | None = None
) -> float | None:
    """Return a vehicle's fence ceiling above its start; None without one.

    changed: the fence in place of the campaign's.
    """
    fence = changed or setup.case.fences.get(vehicle.name)
    if fence is None or fence.ceiling_up_m is None:
        return None
    return fence.ceiling_up_m + vehicle.start.position_ned_m[2]


def disk_item(folder: Path, least_mb: float) -> PreflightItem:
    """Return the preflight item of free disk space for recordings."""
    free_mb = shutil.disk_usage(folder).free / _MEGABYTE
    item = at_least_item("disk", "", free_mb, least_mb, unit="MB", what=f"free space in {folder}")
    return (
        item if item.outcome == "refused" else PreflightItem("disk", "", "ok", None, least_mb, "MB")
    )


def _advice(items: Iterable[PreflightItem]) -> str:
    """Return the remedy for refused parameters that preflight only checks; empty for others."""
    wrong = {item.check for item in items if item.outcome == "refused"}
    if wrong.isdisjoint({"failsafe", "return_altitude"}):
        return ""
    return "; set them in the vehicle, by its params, or with preflight.failsafe: set"


def _position_item(
    context: VehicleContext, position: Vec3 | None, tolerance_m: float
) -> PreflightItem:
    """Return the preflight item of a vehicle's distance from its start pose."""
    away = _from_start(context, position)
    what = f"its distance from its start pose by {context.pose_source}"
    return at_most_item(
        "position",
        context.name,
        None if away is None else norm(away),
        tolerance_m,
        unit="m",
        what=what,
    )


async def _await_positions(contexts: Iterable[VehicleContext]) -> None:
    """Wait for the first poses before the checks: they begin once the frame is anchored."""
    loop = asyncio.get_running_loop()
    deadline_s = loop.time() + _FIRST_POSE_S
    while any(_position(context) is None for context in contexts) and loop.time() < deadline_s:  # noqa: ASYNC110 - a history has no event
        await asyncio.sleep(_POLL_S)


def _position(context: VehicleContext) -> Vec3 | None:
    """Return a vehicle's position by its pose source, for the checks; None without a fresh one."""
    latest = context.poses.at(asyncio.get_running_loop().time())
    if latest.pose is None or latest.gap_s > _FRESH_S:
        return None
    return latest.pose.position_ned_m


def _tilt_items(context: VehicleContext) -> Iterable[PreflightItem]:
    """Yield the preflight item of a vehicle that motion capture has turned over, or on its side."""
    seen = context.poses.at(asyncio.get_running_loop().time())
    estimate = context.driver.state.local
    if seen.pose is None or seen.gap_s > _FRESH_S or estimate is None:
        return
    ours, theirs = (rotate(one.q_wxyz, _DOWN) for one in (seen.pose, estimate.pose))
    apart_deg = math.degrees(2.0 * math.asin(min(1.0, norm(subtract(ours, theirs)) / 2.0)))
    if apart_deg > _TILT_DEG:
        what = (
            "the angle of its vertical axis by motion capture from that by its own estimate (check "
            "`frame`, the order of `q_wxyz`, and the axes of the body)"
        )
        yield at_most_item("mocap", context.name, apart_deg, _TILT_DEG, unit="deg", what=what)


def _from_start(context: VehicleContext, position: Vec3 | None) -> Vec3 | None:
    """Return a vehicle's offset from its start, for the checks; None when unknown."""
    return None if position is None else subtract(position, context.start.position_ned_m)
