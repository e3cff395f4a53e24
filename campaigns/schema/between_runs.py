"""`between_runs`: how an attached vehicle returns to its start."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError, Part


class BetweenRunsPart(Part):
    """The YAML part `between_runs`: what an attached vehicle does between two runs.

    do: `ask` asks a person to put it back; `fly_back` flies it there, and asks only where that is
    not allowed. A bare text is the same as `do`. height_m: of the flight above its start; by
    default the goal's altitude. tolerance_m, tolerance_deg: allowed deviation from its start
    afterwards. speed_m_s: of the flight back.
    """

    shorthand: ClassVar[str] = "do"
    do: Literal["ask", "fly_back"]
    height_m: Annotated[float, Field(gt=0, le=100)] | None = None
    speed_m_s: Annotated[float, Field(gt=0, le=10)] = 0.8
    tolerance_m: Annotated[float, Field(gt=0, le=10)] = 0.3
    tolerance_deg: Annotated[float, Field(gt=0, le=180)] = 10.0

    @model_validator(mode="before")
    @classmethod
    def _shorthand(cls, given: Any) -> Any:
        return {cls.shorthand: given} if isinstance(given, str) else given

    @model_validator(mode="after")
    def _of_flying(self) -> "BetweenRunsPart":
        if self.do == "ask":
            for key in self.model_fields_set - {"do"}:
                raise KeyFaultError(key, "has no effect with between_runs: ask")
        return self
