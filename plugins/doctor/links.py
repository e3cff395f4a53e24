"""Checks what campaign files name: links can be opened, drivers and channels are there."""

import asyncio
from collections.abc import Iterable, Iterator
from pathlib import Path

from wil_campaign.campaigns.expansion.expansion import load_campaign
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.hooks import drivers, operator_channels
from wil_campaign.installed_plugins import load_plugin_object, plugin_additions
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import (
    attached_vehicles,
    flown_vehicles,
)
from wil_campaign.plugins.doctor.findings import CAMPAIGNS, Finding
from wil_campaign.plugins.doctor.installed import (
    driver_remedy,
    is_package_installed,
    package_of_requirement,
)
from wil_campaign.vehicles.links.link import LinkError
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import LinkAddress

_OPEN_S = 5.0


def campaign_link_findings(files: Iterable[Path]) -> Iterator[Finding]:
    """Yield findings on campaign files: whether they are valid and what they name is there."""
    for file in files:
        try:
            campaign = load_campaign(file)
        except BadInput as error:
            text = f"{len(error.problems)} problems; the first: {error.problems[0]}"
            yield Finding(CAMPAIGNS, "trouble", text, f"wil-campaign validate {file}")
            continue
        attached = attached_vehicles(campaign)
        if not attached:
            kinds = {
                "launched" if flown_vehicle.launch else "embedded"
                for flown_vehicle in flown_vehicles(campaign)
            }
            text = f"{file}: its vehicles are {' and '.join(sorted(kinds))}"
            yield Finding(CAMPAIGNS, "good", text)
        for vehicle in attached:
            for address in vehicle.addresses:
                yield asyncio.run(_open_link(f"{file}: {vehicle.name}", address))
        for driver in plugin_additions(drivers).values():
            by_it = {
                flown_vehicle.name
                for flown_vehicle in flown_vehicles(campaign)
                if flown_vehicle.driver == driver.name
            }
            if by_it and not is_package_installed(package_of_requirement(driver.requirement)):
                names = ", ".join(sorted(by_it))
                text = f"{file}: {names}: the driver {driver.name} is not installed"
                yield Finding(CAMPAIGNS, "trouble", text, driver_remedy(driver))
        for name, setup in campaign.operators.items():
            yield from load_plugin_object(plugin_additions(operator_channels)[name].examine)(
                file, setup
            )


async def _open_link(vehicle: str, address: LinkAddress) -> Finding:
    try:
        async with asyncio.timeout(_OPEN_S), open_link(address):
            pass
    except TimeoutError:
        text = f"{vehicle}: {address} did not open within {_OPEN_S:g} s"
        return Finding(CAMPAIGNS, "trouble", text, "check that the host is reachable and answers")
    except LinkError as error:
        return Finding(CAMPAIGNS, "trouble", f"{vehicle}: {error}")
    return Finding(
        CAMPAIGNS,
        "good",
        f"{vehicle}: {address} can be opened",
        "to see which vehicle answers: wil-campaign run --no-arm",
    )
