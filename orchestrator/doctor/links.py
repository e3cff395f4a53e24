"""The links that campaigns name: whether each can be opened from here."""

import asyncio
from collections.abc import Iterable, Iterator
from pathlib import Path

from campaigns.expansion.expansion import load_campaign
from orchestrator.campaign.resuming.attached_vehicles import attached_vehicles, flown_vehicles
from orchestrator.doctor.findings import Finding
from vehicles.links.link import LinkError
from vehicles.links.link_factory import open_link
from vehicles.links.link_strings import LinkAddress
from worlds.files.documents import BadInput

TOPIC = "campaigns"
_OPEN_S = 5.0


def campaign_links(files: Iterable[Path]) -> Iterator[Finding]:
    """Yield a finding per campaign: whether its files are valid and its links open."""
    for file in files:
        try:
            campaign = load_campaign(file)
        except BadInput as error:
            said = f"{len(error.problems)} problems; the first: {error.problems[0]}"
            yield Finding(TOPIC, "trouble", said, f"wil-campaign validate {file}")
            continue
        attached = attached_vehicles(campaign)
        if not attached:
            kinds = {"launched" if one.launch else "embedded" for one in flown_vehicles(campaign)}
            text = f"{file}: its vehicles are {' and '.join(sorted(kinds))}"
            yield Finding(TOPIC, "good", text)
        for vehicle in attached:
            for address in vehicle.addresses:
                yield asyncio.run(_open_link(f"{file}: {vehicle.name}", address))


async def _open_link(who: str, address: LinkAddress) -> Finding:
    try:
        async with asyncio.timeout(_OPEN_S), open_link(address):
            pass
    except TimeoutError:
        text = f"{who}: {address} did not open within {_OPEN_S:g} s"
        return Finding(TOPIC, "trouble", text, "is the host there, and does it answer?")
    except LinkError as error:
        return Finding(TOPIC, "trouble", f"{who}: {error}")
    return Finding(
        TOPIC,
        "good",
        f"{who}: {address} can be opened",
        "who answers there: wil-campaign run --no-arm",
    )
