"""`operator`: the ways in which people follow and command a campaign, beside its terminal."""

from typing import Annotated

from pydantic import AfterValidator

from vehicles.links.parse import LinkAddressError, parse_link
from worlds.documents import Part


def _is_link(link: str) -> str:
    try:
        parse_link(link)
    except LinkAddressError as error:
        raise ValueError(f"must be a link such as udpout://127.0.0.1:14550: {error}") from error
    return link


GcsLink = Annotated[str, AfterValidator(_is_link)]


class GcsPart(Part):
    """Links on which the guard passes a vehicle's MAVLink on to a ground station, and back."""

    real: GcsLink | None = None
    twin: GcsLink | None = None


class OperatorPart(Part):
    """Everything for operators."""

    gcs: GcsPart = GcsPart()
