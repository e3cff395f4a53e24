"""`operator`: how people follow and command a campaign other than by its terminal."""

from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, JsonValue, create_model

from wil_campaign.foundation.files.documents import Document, Part, Problem
from wil_campaign.hooks import operator_channels
from wil_campaign.installed_plugins import absent_additions, load_plugin_object, plugin_additions
from wil_campaign.vehicles.links.link_strings import LinkAddressError, parse_link


def _is_link(link: str) -> str:
    """Refuse an operator's ground station link of the wrong form."""
    try:
        address = parse_link(link)
    except LinkAddressError as error:
        raise ValueError(f"must be a link such as udpout://127.0.0.1:14550: {error}") from error
    if address.kind == "memory":
        raise ValueError(
            "memory:// connects to nothing; write udpout://, udpin://, tcpin:// or serial"
        )
    return link


OnLoss = Literal["continue", "hold", "abort"]
GcsLink = Annotated[str, AfterValidator(_is_link)]


class GcsPart(Part):
    """The operator's `gcs`: links on which the guard relays a vehicle's MAVLink to a GCS.

    A ground station there reads, and takes over; what would change the vehicle is not forwarded.

    real, twin: the link to the ground station for that vehicle, such as udpout://127.0.0.1:14550;
    by default none.
    """

    real: GcsLink | None = None
    twin: GcsLink | None = None


class OperatorPart(Part):
    """The campaign's `operator`: ground stations, channels, and the action on operator loss.

    on_operator_loss: the action when a channel was unreachable for lost_after_s. gcs: ground
    stations that monitor and command the vehicles through the guard. lost_after_s: how long a
    channel may be unreachable.
    """

    gcs: GcsPart = GcsPart()
    on_operator_loss: OnLoss = "continue"
    lost_after_s: Annotated[float, Field(gt=0, le=3600)] = 10.0

    @property
    def channels(self) -> dict[str, "ChannelPart"]:
        """Return by their keys the channels that the campaign names."""
        given = {name: getattr(self, name, None) for name in plugin_additions(operator_channels)}
        return {name: part for name, part in given.items() if part is not None}


class ChannelPart(Part):
    """The value of a key of `operator` that a plugin adds: a channel by which people command."""

    def setup(self, file: Document, operator: OperatorPart, problems: list[Problem]) -> object:
        """Return the channel's setup as it is opened with; what is missing is noted."""
        raise NotImplementedError

    @property
    def permits(self) -> Mapping[str, str]:
        """Return what the campaign permits that is unsafe, in words, by the key and its value."""
        return {}


@cache
def operator_model() -> type[OperatorPart]:
    """Return the model of `operator`, with the channels that plugins add."""
    keys: dict[str, Any] = {
        name: (
            load_plugin_object(channel.part) | None,
            Field(default=None, description=channel.summary),
        )
        for name, channel in plugin_additions(operator_channels).items()
    }
    keys |= {
        name: (refused_key_type(why), None)
        for name, why in absent_additions(operator_channels).items()
    }
    return create_model(
        OperatorPart.__name__, __base__=OperatorPart, __doc__=OperatorPart.__doc__, **keys
    )


def refused_key_type(why: str) -> Any:
    """Return the type of a key of which each value is refused. why: the message."""

    def refuse(_: object) -> object:
        raise ValueError(why)

    return Annotated[JsonValue, AfterValidator(refuse)]
