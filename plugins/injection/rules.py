"""Rules for whether an autopilot acts on an injected message, by its parameters and mode; pure.

An injected message that the autopilot ignores looks like a vehicle that does not avoid. So before
arming each injection is checked by rules: parameters, modes, and messages that are never used. The
tables are in `ardupilot_rules` and `px4_rules`, each line with its source.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

from wil_campaign.vehicles.setpoints import Setpoints

InjectionKind = Literal[
    "obstacle_distance",
    "obstacle_distance_3d",
    "path_planning",
    "distance_sensor",
    "distance_sensor_sideways",
    "adsb_vehicle",
    "other_global_position",
    "collision",
    "landing_target",
    "vision_position_estimate",
    "odometry",
    "gps_input",
    "fence",
    "flight_termination",
    "inject_failure",
]


@dataclass(frozen=True, slots=True)
class InjectionSituation:
    """The input of injection rules. mode: the autopilot's own name ("GUIDED").

    unbooted: parameters that were set since the autopilot booted.
    """

    parameters: Mapping[str, float]
    mode: str
    setpoints: Setpoints = "velocity"
    unbooted: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class IgnoredInjection:
    """Why an injection would be ignored by the autopilot, and the remedy.

    parameter, value: to set; None when no parameter helps. reboot: whether it takes effect only
    after a reboot.
    """

    reason: str
    remedy: str
    parameter: str | None = None
    value: float | None = None
    reboot: bool = False

    def __str__(self) -> str:
        return f"{self.reason}; {self.remedy}"


class InjectionRule(Protocol):
    """A rule of injection support: one condition for the autopilot to use an injection."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names of the parameters that the rule reads."""

    def broken(self, situation: InjectionSituation) -> IgnoredInjection | None:
        """Return why the rule does not hold; None when it does."""


@dataclass(frozen=True, slots=True)
class ParameterRule:
    """A rule that a parameter has one of some values, all of some bits, or exceeds a number.

    parameter: its name; more_names: those of other versions. advised: the value to set, or the
    bits to add. meaning: the consequence, as the end of "PARAMETER is 0: ...".
    """

    parameter: str
    meaning: str
    advised: float
    one_of: tuple[float, ...] = ()
    bits: int = 0
    above: float | None = None
    more_names: tuple[str, ...] = ()
    reboot: bool = False

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the parameter's names in this rule, the current one first."""
        return (self.parameter, *self.more_names)

    def broken(self, situation: InjectionSituation) -> IgnoredInjection | None:
        """Return what is wrong with the rule's parameter, also when it is missing."""
        name = next((each for each in self.parameters if each in situation.parameters), None)
        if name is None:
            return IgnoredInjection(
                f"{self.parameter} does not exist on this autopilot: {self.meaning}",
                "its firmware lacks the feature, or its parameter is hidden until the one that "
                "enables it is set",
                self.parameter,
                self.advised,
                self.reboot,
            )
        present = situation.parameters[name]
        if self._is_fulfilled_by(present):
            return self._needs_boot(name, present) if name in situation.unbooted else None
        value = float(round(present) | self.bits) if self.bits else self.advised
        after = " and reboot the autopilot" if self.reboot else ""
        return IgnoredInjection(
            f"{name} is {present:g}: {self.meaning}",
            f"set {name} to {value:g}{after}",
            name,
            value,
            self.reboot,
        )

    def _needs_boot(self, name: str, value: float) -> IgnoredInjection | None:
        """Return that a parameter of the rule takes effect only after a boot."""
        if not self.reboot:
            return None
        return IgnoredInjection(
            f"{name} was set to {value:g} since the autopilot booted, and takes effect at the next "
            f"boot: until then {self.meaning}",
            f"set {name} to {value:g} in the vehicle itself, reboot it, and then fly",
            name,
            value,
            reboot=True,
        )

    def _is_fulfilled_by(self, value: float) -> bool:
        if self.bits:
            return round(value) & self.bits == self.bits
        if self.above is not None:
            return value > self.above
        return value in self.one_of


@dataclass(frozen=True, slots=True)
class ModesRule:
    """A rule that only some modes use the injection. why: end of "in mode X: ..."."""

    modes: frozenset[str]
    why: str

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return none: this rule is about modes."""
        return ()

    def broken(self, situation: InjectionSituation) -> IgnoredInjection | None:
        """Return that the mode is not one of the rule's."""
        if situation.mode in self.modes:
            return None
        choices = " or ".join(sorted(self.modes))
        return IgnoredInjection(f"in mode {situation.mode}: {self.why}", f"fly in {choices}")


@dataclass(frozen=True, slots=True)
class ConditionalRule:
    """A rule that applies only in some modes, and only for some setpoints."""

    rule: InjectionRule
    modes: frozenset[str]
    setpoints: Setpoints | None = None

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the inner rule's parameters."""
        return self.rule.parameters

    def broken(self, situation: InjectionSituation) -> IgnoredInjection | None:
        """Return the inner rule's result, where it applies."""
        if situation.mode not in self.modes:
            return None
        if self.setpoints is not None and situation.setpoints != self.setpoints:
            return None
        return self.rule.broken(situation)


@dataclass(frozen=True, slots=True)
class NeverRule:
    """A rule that the autopilot never uses this injection."""

    why: str
    remedy: str

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return none: this rule never holds."""
        return ()

    def broken(self, _situation: InjectionSituation) -> IgnoredInjection | None:
        """Return that the autopilot never uses the injection."""
        return IgnoredInjection(self.why, self.remedy)


Rules = Mapping[InjectionKind, tuple[InjectionRule, ...]]


def broken_injection_rules(
    rules: Rules, thing: InjectionKind, situation: InjectionSituation
) -> tuple[IgnoredInjection, ...]:
    """Return why an injection would be ignored, in the order of the rules."""
    results = (rule.broken(situation) for rule in rules[thing])
    return tuple(result for result in results if result is not None)


def parameters_in_rules(rules: Rules, thing: InjectionKind) -> tuple[str, ...]:
    """Return the names of all parameters that the injection rules read, each once."""
    return tuple(dict.fromkeys(name for rule in rules[thing] for name in rule.parameters))
