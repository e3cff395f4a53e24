"""`autonomy`: the system under test, how often it is called, and its limits of memory and time."""

from typing import Annotated, Any, ClassVar, Self

from pydantic import Field, JsonValue, model_validator

from campaigns.values.autonomy_limits import LONGEST_BUILD_S, LONGEST_CALL_S, AutonomyLimits
from worlds.files.documents import KeyFaultError, Part

_DEFAULT = AutonomyLimits()


class AutonomyLimitsPart(Part):
    """The `limits` of the campaign's autonomy. memory_mb: by how many MB its process may grow.

    call_s: wall time of one call of `perceive` or `act`; build_s: of its import and constructor.
    """

    memory_mb: Annotated[float, Field(ge=50, le=10_000_000)] = _DEFAULT.memory_mb
    call_s: Annotated[float, Field(ge=0.01, le=LONGEST_CALL_S)] = _DEFAULT.call_s
    build_s: Annotated[float, Field(ge=0.1, le=LONGEST_BUILD_S)] = _DEFAULT.build_s

    def limits(self) -> AutonomyLimits:
        """Return the limits as a run takes them."""
        return AutonomyLimits(self.memory_mb, self.call_s, self.build_s)


class AutonomyPart(Part):
    """The campaign's `autonomy`, the system under test.

    use: file.py:Class beside the file, or a shipped name. with: its parameters. program: instead,
    a program with its arguments, run in the folder of this file. rate_hz: how often the class of
    `use` is called for a setpoint. limits: of memory and time. A bare text is the same as `use`.
    """

    shorthand: ClassVar[str] = "use"
    use: Annotated[str, Field(min_length=1)] | None = None
    program: Annotated[list[str], Field(min_length=1)] | None = None
    with_: dict[str, JsonValue] = Field(default_factory=dict, alias="with")
    rate_hz: Annotated[float, Field(ge=2, le=250)] = 20.0
    limits: AutonomyLimitsPart = AutonomyLimitsPart()

    @model_validator(mode="before")
    @classmethod
    def _shorthand(cls, given: Any) -> Any:
        """Accept a bare text as the campaign autonomy's `use`."""
        return {cls.shorthand: given} if isinstance(given, str) else given

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        """Require either `use` or `program` of a campaign's autonomy."""
        if self.use is None and self.program is None:
            raise ValueError("give use: (a class) or program: (a command line)")
        if self.program is not None:
            for key in ("use", "rate_hz"):
                if key in self.model_fields_set:
                    raise KeyFaultError(key, "has no effect with a program")
            for key in ("call_s", "build_s"):
                if key in self.limits.model_fields_set:
                    raise KeyFaultError(("limits", key), "has no effect with a program")
        return self
