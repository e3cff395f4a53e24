"""The campaign's `inject`: what it says of injections, and their setups."""

from typing import Annotated, Any, Self

from pydantic import Field, field_validator, model_validator

from wil_campaign.campaigns.schema import CampaignPart
from wil_campaign.foundation.files.documents import Document, KeyFaultError, Part, Problem
from wil_campaign.plugins.injection.injection_setups import InjectionSetup, InjectionSetups
from wil_campaign.recipes.working import SIDES, Side

RateHz = Annotated[float, Field(gt=0, le=250)]


class _ToVehicles(Part):
    """An injection's vehicles and rate.

    to: the vehicles whose autopilots receive it; by default all. rate_hz: highest rate, up to 250;
    by default the usual one of the message.
    """

    to: Annotated[list[Side], Field(min_length=1)] = Field(default_factory=lambda: [*SIDES])
    rate_hz: RateHz | None = None

    @field_validator("to")
    @classmethod
    def _once_each(cls, to: list[Side]) -> list[Side]:
        """Refuse an injection that names a vehicle twice."""
        if len(set(to)) != len(to):
            raise ValueError("names a vehicle twice")
        return to


class OfSensorPart(_ToVehicles):
    """An injection made of a sensor's mixed readings.

    sensor: the recipe's name of the sensor whose mixed readings are sent.
    """

    sensor: Annotated[str, Field(min_length=1)]


class OfObjectsPart(_ToVehicles):
    """An injection made of the places of several objects of the virtual world.

    objects: their names in the world file.
    """

    objects: Annotated[list[str], Field(min_length=1)]


class OfObjectPart(_ToVehicles):
    """An injection made of the place of one object of the virtual world.

    object: its name in the world file.
    """

    object: Annotated[str, Field(min_length=1)]


class OfPosePart(_ToVehicles):
    """An injected pose: motion capture as it arrives, or a mixed sensor of type pose.

    sensor: the recipe's name of a mixed sensor of type pose; by default motion capture as it
    arrives.
    """

    sensor: Annotated[str, Field(min_length=1)] | None = None


class InjectPart(Part):
    """The campaign's `inject`: deliveries to autopilots by the name of the MAVLink message."""

    obstacle_distance: OfSensorPart | None = None
    distance_sensor: OfSensorPart | None = None
    adsb_vehicle: OfObjectsPart | None = None
    landing_target: OfObjectPart | None = None
    vision_position_estimate: OfPosePart | None = None
    odometry: OfPosePart | None = None

    @model_validator(mode="after")
    def _one_estimate(self) -> Self:
        """Refuse two delivered pose estimates (vision position and odometry)."""
        if self.vision_position_estimate is not None and self.odometry is not None:
            raise KeyFaultError("odometry", "vision_position_estimate delivers the pose already")
        return self

    def setups(self) -> tuple[InjectionSetup, ...]:
        """Return the injections to deliver, in the order of the messages above."""
        found: list[InjectionSetup] = []
        for thing in type(self).model_fields:
            part: _ToVehicles | None = getattr(self, thing)
            if part is None:
                continue
            objects: tuple[str, ...] = ()
            if isinstance(part, OfObjectsPart):
                objects = tuple(part.objects)
            elif isinstance(part, OfObjectPart):
                objects = (part.object,)
            found.append(
                InjectionSetup(
                    thing=thing,  # type: ignore[arg-type]  # the fields are its values
                    to=tuple(part.to),
                    sensor=part.sensor if isinstance(part, OfSensorPart | OfPosePart) else None,
                    objects=objects,
                    rate_hz=part.rate_hz,
                )
            )
        return tuple(found)


def inject_field() -> tuple[Any, Any]:
    """Return the type and the field of the key `inject`."""
    return InjectPart, InjectPart()


def injection_setups(
    given: InjectPart, _campaign: Document, _part: CampaignPart, _problems: list[Problem]
) -> InjectionSetups | None:
    """Return a case's injections; None without any."""
    setups = given.setups()
    return InjectionSetups(setups) if setups else None
