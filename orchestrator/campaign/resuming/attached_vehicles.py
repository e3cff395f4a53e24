"""Attached vehicles of a campaign, found and identified over their links.

A vehicle that is neither embedded nor launched may be hardware, also behind a port of loopback.
"""

import asyncio
import itertools
import time
from collections.abc import Iterable
from dataclasses import dataclass

from wil_campaign.campaigns.expansion.composition import is_composition
from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.campaigns.setup.vehicle_setups import FlownSetup, VehicleSetup
from wil_campaign.orchestrator.run_results.campaign_results import VehicleKind
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.session.identity import VehicleIdentity, same_vehicle
from wil_campaign.vehicles.errors import IdentifyError
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.links.link_conditions import (
    LinkConditions,
    LinkSite,
    link_under_conditions,
)
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import LinkAddress
from wil_campaign.vehicles.links.udp import RIVAL_REMEDY, UdpLink
from wil_campaign.vehicles.mavlink.names import message_name

_POSITION_S = 3.0
"""How long to wait for a position and a battery state, which a vehicle may not have."""
_POLL_S = 0.05
_HEARTBEATS_S = 1.2
"""Enough for one heartbeat of each vehicle on the link: they come every second."""


@dataclass(frozen=True, slots=True)
class AttachedVehicle:
    """An attached vehicle that was identified over its link.

    place_deg: latitude and longitude by its own estimate, None while it knows none. battery: 0 to
    1, None where unknown. truth: the message in which its simulator sent its ground truth, where
    that was asked for; empty for none.
    """

    name: str
    address: str
    identity: VehicleIdentity
    place_deg: tuple[float, float] | None
    battery: float | None
    armed: bool
    truth: str = ""

    def __str__(self) -> str:
        """Return the attached vehicle in words."""
        identity = self.identity
        kind = "a simulation" if identity.simulation else f"board {identity.uid}"
        battery = "" if self.battery is None else f", battery {self.battery:.0%}"
        return (
            f"{self.name}: {identity.autopilot} {identity.version_text} {identity.vehicle_type}, "
            f"system {identity.system_id}, {kind}, on {self.address}, {self.where}{battery}"
        )

    @property
    def where(self) -> str:
        """Return the attached vehicle's place in words."""
        if self.place_deg is None:
            return "position unknown"
        return f"at {self.place_deg[0]:.6f}, {self.place_deg[1]:.6f}"

    @property
    def judged_text(self) -> str:
        """Return by what it is judged, where its file leaves that open."""
        if self.truth:
            return (
                f"{self.name}: judged by its simulator's ground truth ({self.truth}); "
                f"vehicles.{self.name}.pose_source=mavlink judges by its estimate"
            )
        why = "sends no ground truth" if self.identity.simulation else "is no simulation"
        return f"{self.name}: judged by its estimate, as it {why}"


def planned_modes(campaign: Campaign, case: str) -> list[Mode]:
    """Return the modes in which runs of a case or control are planned.

    They may be fewer than the campaign's: the parts of a composed one have their own.
    """
    planned = {plan.mode for plan in campaign.plans if plan.case == case}
    return [mode for mode in campaign.modes if mode in planned]


def planned_setups(campaign: Campaign) -> list[tuple[Case, Mode]]:
    """Return the setup of each case and control with each mode in which it is planned."""
    return [
        (setup, mode)
        for case, setup in campaign.setups.items()
        for mode in planned_modes(campaign, case)
    ]


def flown_vehicles(campaign: Campaign) -> tuple[FlownSetup, ...]:
    """Return the vehicles, including actors, that fly in any planned run of the campaign."""
    vehicles: dict[tuple[str, object], FlownSetup] = {}
    for setup, mode in planned_setups(campaign):
        for vehicle in setup.flown_in(mode):
            vehicles.setdefault((vehicle.name, vehicle.link), vehicle)
    return tuple(vehicles.values())


def attached_vehicles(campaign: Campaign) -> tuple[FlownSetup, ...]:
    """Return the campaign's attached vehicles: neither embedded nor launched."""
    return tuple(
        flown_vehicle
        for flown_vehicle in flown_vehicles(campaign)
        if flown_vehicle.attached is not None
    )


def vehicles_with_open_poses(campaign: Campaign) -> tuple[str, ...]:
    """Return the vehicles whose pose source the campaign leaves open in each of its cases.

    None of a composition: a setting holds for all of its parts, which may lack the vehicle.
    """
    if is_composition(campaign.document):
        return ()
    flown = [one for setup, mode in planned_setups(campaign) for one in setup.flown_in(mode)]
    given = {one.name for one in flown if not _leaves_poses_open(one)}
    return tuple(dict.fromkeys(one.name for one in flown if one.name not in given))


def _leaves_poses_open(vehicle: FlownSetup) -> bool:
    return isinstance(vehicle, VehicleSetup) and vehicle.asks_pose_source


def kinds_of_real(
    campaign: Campaign, found: Iterable[AttachedVehicle]
) -> dict[VehicleKind, list[str]]:
    """Return what flies as the real vehicle, with the cases and controls in which it does.

    found: the campaign's attached vehicles, identified, in their order.
    """
    attached = zip(attached_vehicles(campaign), found, strict=True)
    identified = {one.link: each for one, each in attached if one.name == "real"}
    cases: dict[VehicleKind, list[str]] = {}
    for case, setup in campaign.setups.items():
        flown = [one for mode in planned_modes(campaign, case) for one in setup.flown_in(mode)]
        real = next((one for one in flown if one.name == "real"), None)
        if real is not None:
            cases.setdefault(_kind_of(real, identified.get(real.link)), []).append(case)
    return cases


def _kind_of(real: FlownSetup, identified: AttachedVehicle | None) -> VehicleKind:
    """Return what flies as a real vehicle: hardware, a simulation, or an embedded one."""
    if real.embedded:
        return "embedded"
    if real.launch is not None:
        return "sitl"
    if identified is None:
        return "unknown"
    return "sitl" if identified.identity.simulation else "hardware"


async def find_attached_vehicles(
    vehicles: Iterable[FlownSetup], timeout_s: float
) -> tuple[AttachedVehicle, ...]:
    """Connect to the attached vehicles and identify them. Raises the first VehicleError.

    Nothing is changed in the vehicles, and their links are closed again.
    """
    found = await asyncio.gather(*(_find(vehicle, timeout_s) for vehicle in vehicles))
    for one, other in itertools.combinations(found, 2):
        if one.name != other.name and same_vehicle(one.identity, other.identity):
            raise IdentifyError(
                f"{one.name} on {one.address} and {other.name} on {other.address} are one vehicle "
                f"(uid {one.identity.uid})"
            )
    return tuple(found)


async def _find(vehicle: FlownSetup, timeout_s: float) -> AttachedVehicle:
    """Connect to an attached vehicle and identify it. Raises VehicleError."""
    if vehicle.attached is None:
        raise ValueError(f"{vehicle.name} is not attached")
    conditions = LinkConditions(signing=vehicle.signing)
    signed = vehicle.signing is not None
    raw = [open_link(address, signed=signed) for address in vehicle.addresses]
    site = LinkSite(vehicle.system_id)
    link = link_under_conditions(raw, conditions, utc_s=time.time(), site=site).link
    driver = Driver(
        name=vehicle.name,
        link=link,
        autopilot=vehicle.autopilot,
        system_id=vehicle.system_id,
        rates=vehicle.rates,
    )
    if _leaves_poses_open(vehicle):
        driver.on_truth(lambda _: None)
    return await _identify(driver, raw, address=link.name, timeout_s=timeout_s)


async def find_vehicle_at(address: LinkAddress, timeout_s: float) -> AttachedVehicle:
    """Connect to the vehicle at an address and identify it. Raises VehicleError.

    Nothing is changed in it, and the link is closed again.
    """
    link = open_link(address)
    driver = Driver(name="vehicle", link=link)
    return await _identify(driver, [link], address=str(address), timeout_s=timeout_s)


async def _identify(
    driver: Driver, links: Iterable[Link], *, address: str, timeout_s: float
) -> AttachedVehicle:
    """Identify a driver's vehicle, wait for its position and battery. Raises VehicleError."""
    loop = asyncio.get_running_loop()
    async with driver:
        began_s = loop.time()
        identity = await driver.identify(timeout_s)
        for _ in range(round(_POSITION_S / _POLL_S)):
            is_known = _has_position_and_battery(driver) and _has_sent_truth(driver, identity)
            if is_known and loop.time() - began_s >= _HEARTBEATS_S:
                break
            await asyncio.sleep(_POLL_S)
        _refuse_rivals(driver.name, links)
        state = driver.state
        return AttachedVehicle(
            name=driver.name,
            address=address,
            identity=identity,
            place_deg=driver.place_deg,
            battery=None if state.battery is None else state.battery.remaining,
            armed=state.armed,
            truth=_truth_message(identity) if driver.truth.count else "",
        )


def _has_sent_truth(driver: Driver, identity: VehicleIdentity) -> bool:
    """Return whether a ground truth has come, or is not waited for."""
    return bool(driver.truth.count) or not (driver.truth.wanted and identity.simulation)


def _truth_message(identity: VehicleIdentity) -> str:
    return message_name(autopilot_named(identity.autopilot).truth_message_id)


def _refuse_rivals(name: str, links: Iterable[Link]) -> None:
    """Refuse two attached vehicles with one system id on one port. Raises IdentifyError."""
    for link in links:
        rival = next(iter(link.rivals.values()), None) if isinstance(link, UdpLink) else None
        if rival is not None:
            raise IdentifyError(f"{name} on {link.name}: {rival}; {RIVAL_REMEDY}")


def _has_position_and_battery(driver: Driver) -> bool:
    """Return whether a vehicle has reported its position and battery."""
    return driver.place_deg is not None and driver.state.battery is not None
