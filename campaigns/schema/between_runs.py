"""`between_runs`: how an attached vehicle comes back to its start."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from worlds.files.documents import KeyFaultError, Part


class BetweenRunsPart(Part):
    """The YAML part `between_runs`: what an attached vehicle does between two runs.

    do: `ask` has a person put it back; `fly_back` has it fly there, and asks only where that must
    not be. A bare text stands for `do`. height_m: above its start; without it, the goal's altitude.
    tolerance_m, tolerance_deg: how far from its start it may stand then. speed_m_s: how fast it
    flies back.
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
