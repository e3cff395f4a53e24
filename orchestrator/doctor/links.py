"""Checks what campaign files name: links can be opened, driver and broker are there."""

import asyncio
import socket
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from pathlib import Path

from campaigns.expansion.expansion import load_campaign
from campaigns.values.broker_address import BrokerAddress
from orchestrator.campaign.resuming.attached_vehicles import attached_vehicles, flown_vehicles
from orchestrator.doctor.findings import Finding
from orchestrator.doctor.installed import MAVSDK_REMEDY
from vehicles.links.link import LinkError
from vehicles.links.link_factory import open_link
from vehicles.links.link_strings import LinkAddress
from worlds.files.documents import BadInput

TOPIC = "campaigns"
_OPEN_S = 5.0


def campaign_links(files: Iterable[Path]) -> Iterator[Finding]:
    """Yield findings on campaign files: whether they are valid and what they name is there."""
    for file in files:
        try:
            campaign = load_campaign(file)
        except BadInput as error:
            text = f"{len(error.problems)} problems; the first: {error.problems[0]}"
            yield Finding(TOPIC, "trouble", text, f"wil-campaign validate {file}")
            continue
        attached = attached_vehicles(campaign)
        if not attached:
            kinds = {"launched" if one.launch else "embedded" for one in flown_vehicles(campaign)}
            text = f"{file}: its vehicles are {' and '.join(sorted(kinds))}"
            yield Finding(TOPIC, "good", text)
        for vehicle in attached:
            for address in vehicle.addresses:
                yield asyncio.run(_open_link(f"{file}: {vehicle.name}", address))
        by_mavsdk = {one.name for one in flown_vehicles(campaign) if one.driver == "mavsdk"}
        if by_mavsdk and find_spec("mavsdk") is None:
            text = f"{file}: {', '.join(sorted(by_mavsdk))}: the driver mavsdk is not installed"
            yield Finding(TOPIC, "trouble", text, MAVSDK_REMEDY)
        if campaign.mqtt is not None:
            yield from _reach_broker(file, campaign.mqtt.broker)


def _reach_broker(file: Path, broker: BrokerAddress) -> Iterator[Finding]:
    """Yield the finding on a campaign's MQTT broker; none on one that the campaign starts."""
    if broker.embedded:
        return
    try:
        with socket.create_connection((broker.host, broker.port), timeout=_OPEN_S):
            pass
    except OSError as error:
        text = f"{file}: the broker {broker} does not answer: {error.strerror or error}"
        yield Finding(TOPIC, "trouble", text, "start it, or check its address and the network")
    else:
        yield Finding(TOPIC, "good", f"{file}: a program answers at the broker's {broker}")


async def _open_link(vehicle: str, address: LinkAddress) -> Finding:
    try:
        async with asyncio.timeout(_OPEN_S), open_link(address):
            pass
    except TimeoutError:
        text = f"{vehicle}: {address} did not open within {_OPEN_S:g} s"
        return Finding(TOPIC, "trouble", text, "check that the host is reachable and answers")
    except LinkError as error:
        return Finding(TOPIC, "trouble", f"{vehicle}: {error}")
    return Finding(
        TOPIC,
        "good",
        f"{vehicle}: {address} can be opened",
        "to see which vehicle answers: wil-campaign run --no-arm",
    )
