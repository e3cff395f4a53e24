"""The schema of bench files, and a campaign's `bench`: the request for the one it is flown on.

They are of the core: `validate`, `judge` and `run --bench-file` on this machine read them. Engines
that fly on benches of other machines are of plugins.
"""

from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from wil_campaign.campaigns.schema.fence import GeofencePart
from wil_campaign.campaigns.schema.vehicles import VehiclePart
from wil_campaign.foundation.files.documents import KeyFaultError, Part

BenchName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
"""A name that is part of a cluster resource's name, and of file names."""
PropertyName = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
PropertyValue = bool | int | float | str
Properties = dict[PropertyName, PropertyValue]

OF_VEHICLE = "autopilot"
"""The property that every bench has: the autopilot of its real vehicle."""


class BenchRequestPart(Part):
    """The campaign's `bench`: the bench it is flown on; a bare text is the same as `name`.

    name: of the bench. properties: those that the bench must have, each with this value. wait_s:
    how long to wait for a bench that is missing from the cluster, or busy.
    """

    shorthand: ClassVar[str] = "name"
    name: BenchName | None = None
    properties: Properties = Field(default_factory=dict)
    wait_s: Annotated[float, Field(ge=0, le=86_400)] = 60.0

    @model_validator(mode="before")
    @classmethod
    def _shorthand(cls, given: Any) -> Any:
        """Accept a bare text as the bench's name."""
        return {cls.shorthand: given} if isinstance(given, str) else given

    @model_validator(mode="after")
    def _require_something(self) -> Self:
        if self.name is None and not self.properties:
            raise ValueError("give the name of a bench, or properties that it must have")
        return self


class BenchVehiclesPart(Part):
    """The bench's `vehicles`: the real one.

    real: as in a campaign; its link leads to hardware.
    """

    real: VehiclePart

    @model_validator(mode="after")
    def _attached(self) -> Self:
        """Refuse an embedded or launched vehicle: a bench has a real one."""
        if not isinstance(self.real.link, str) or self.real.link == "embedded":
            message = "must be a link such as udpin://0.0.0.0:14550: a bench has a real vehicle"
            raise KeyFaultError(("real", "link"), message)
        return self


class ArmingPart(Part):
    """The bench's `arming`: the users who may consent to arm, on the terminal of the bench.

    users: names of users of the bench's machine; by default any user at its terminal.
    """

    users: Annotated[list[Annotated[str, Field(min_length=1)]], Field(min_length=1)] | None = None


class BenchPart(Part):
    """A bench file: a place with a real vehicle, on which campaigns are flown.

    schema: the kind and version of the file. bench: its name. description: for people. properties:
    which a campaign may request in place of the name; `autopilot` is that of the vehicle. vehicles:
    the real one: link, autopilot, cameras, motion capture. geofence: where vehicles may be in this
    place. arming: the users who may consent to arm.
    """

    schema_: Literal["wil/bench/1"] = Field(alias="schema")
    bench: BenchName
    description: str = ""
    properties: Properties = Field(default_factory=dict)
    vehicles: BenchVehiclesPart
    geofence: GeofencePart
    arming: ArmingPart = ArmingPart()

    @model_validator(mode="after")
    def _properties_once(self) -> Self:
        """Refuse the property that is derived from the bench's vehicle."""
        if OF_VEHICLE in self.properties:
            message = "is that of vehicles.real already; remove it"
            raise KeyFaultError(("properties", OF_VEHICLE), message)
        return self
