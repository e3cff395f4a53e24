"""`autonomy`: the system under test, how often it is called, and its limits of memory and time."""

from functools import cache
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field, JsonValue, create_model, model_validator

from wil_campaign.campaigns.schema.operator import refused_key_type
from wil_campaign.campaigns.values.autonomy_limits import (
    LONGEST_BUILD_S,
    LONGEST_CALL_S,
    AutonomyLimits,
)
from wil_campaign.foundation.files.documents import KeyFaultError, Part
from wil_campaign.hooks import autonomy_kinds
from wil_campaign.installed_plugins import absent_additions, load_plugin_object, plugin_additions

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

    use: file.py:Class beside the file, or a shipped name. with: its parameters. rate_hz: how often
    the class of `use` is called for a setpoint. limits: of memory and time. A bare text is the same
    as `use`.
    """

    shorthand: ClassVar[str] = "use"
    use: Annotated[str, Field(min_length=1)] | None = None
    with_: dict[str, JsonValue] = Field(default_factory=dict, alias="with")
    rate_hz: Annotated[float, Field(ge=2, le=250)] = 20.0
    limits: AutonomyLimitsPart = AutonomyLimitsPart()

    @property
    def foreign(self) -> tuple[str, ...]:
        """Return the keys of plugins' kinds of autonomy that the campaign has: one, or none."""
        kinds = plugin_additions(autonomy_kinds)
        return tuple(name for name in kinds if getattr(self, name, None) is not None)

    @model_validator(mode="before")
    @classmethod
    def _shorthand(cls, given: Any) -> Any:
        """Accept a bare text as the campaign autonomy's `use`."""
        return {cls.shorthand: given} if isinstance(given, str) else given

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        """Require `use` or one other kind of a campaign's autonomy."""
        if self.use is None and not self.foreign:
            others = (
                f"{autonomy_kind.name}: ({autonomy_kind.value})"
                for autonomy_kind in plugin_additions(autonomy_kinds).values()
            )
            raise ValueError(f"give {' or '.join(('use: (a class)', *others))}")
        for name in self.foreign[:1]:
            kind = plugin_additions(autonomy_kinds)[name]
            why = f"has no effect with a {kind.noun or name}"
            # What the run calls has a rate, and a limit of a call.
            keys, limits = (
                (("rate_hz",), ("call_s", "build_s")) if kind.runner else ((), ("build_s",))
            )
            for key in ("use", *keys, *self.foreign[1:]):
                if key in self.model_fields_set:
                    raise KeyFaultError(key, why)
            for key in limits:
                if key in self.limits.model_fields_set:
                    raise KeyFaultError(("limits", key), why)
        return self


@cache
def autonomy_model() -> type[AutonomyPart]:
    """Return the model of `autonomy`, with the kinds that plugins add."""
    kinds = plugin_additions(autonomy_kinds, AutonomyPart.model_fields)
    keys = {name: load_plugin_object(kind.field)() for name, kind in kinds.items()}
    keys |= {
        name: (refused_key_type(why), None)
        for name, why in absent_additions(autonomy_kinds).items()
    }
    return create_model(
        AutonomyPart.__name__, __base__=AutonomyPart, __doc__=AutonomyPart.__doc__, **keys
    )
