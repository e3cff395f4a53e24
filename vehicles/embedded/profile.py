"""Profiles: noise, wind, battery and delays of a vehicle and its place, each number with a source.

A profile describes a vehicle and a place; it is never tuned per campaign. A file may name a `base`,
and say only what differs.
"""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import (
    BadInput,
    Document,
    KeyFaultError,
    Part,
    YamlEntry,
    check_document,
    closest_word,
    load_document,
)
from wil_campaign.foundation.files.yaml_nodes import YamlNode, mapping_node

_FOLDER = Path(__file__).parent / "profiles"

Nonnegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Pair = tuple[Nonnegative, Nonnegative]
"""Horizontal and vertical, each axis."""


_MOTORS = 4
_G_M_S2 = 9.80665
_HEAVIEST_KG = 150.0
_LONGEST_ARM_M = 3.0
"""Beyond any quadrotor: a larger number was probably typed in grams, or in centimetres."""
_FAR_ARMS = 2.0
"""A body with all of its mass so many arms away has more inertia than any quadrotor."""
_THRUST_PER_MOTOR_WEIGHT = 60.0
"""A motor pulls at most so many times its own weight, so that its weight follows from its thrust.

Racing motors are the strongest for their weight: 28 to 34 g pull about 1.5 kg, 44 to 54 times it
(Ryan Harrell, interviewed by FPV Know-It-All, 2018). The motors alone have this much inertia at
the ends of their arms, whatever the rest of the body has.
"""
_USUAL_SHARES = {"xx": 0.2, "yy": 0.2, "zz": 0.4}
_PUBLISHED_SHARES = {"xx": (0.15, 0.31), "yy": (0.15, 0.31), "zz": (0.26, 0.5)}
"""Of mass times arm², that published quadrotors have: those of the profiles."""
_UNUSUAL = 1.4
"""So many times beside the published shares an inertia is probably another drone's.

A racer of 0.752 kg has 0.124 (the one of `tests/vehicles/embedded/physics/test_parts.py`). With
half of the least share the motors' spread in the profile `cage` already moves a drone twice as far
aside at takeoff.
"""


_BEYOND_ANY = 1e6
"""kg, or m: no drone has so much."""


class ProfileError(ValueError):
    """An unknown profile. suggestion: the name that was probably meant; empty if there is none."""

    def __init__(self, message: str, suggestion: str = "") -> None:
        super().__init__(message)
        self.suggestion = suggestion


class AirMovement(Part):
    """A profile's wind: first-order Gauss-Markov, NED, of zero mean."""

    sigma_m_s: tuple[Nonnegative, Nonnegative, Nonnegative]
    time_constant_s: Positive


class Motors(Part):
    """A profile's motors: lag of thrust, and the spread (standard deviation) between motors."""

    lag_s: Positive
    spread: Annotated[float, Field(ge=0.0, le=0.2)]


class Battery(Part):
    """A profile's battery; `thrust_loss`: part of the thrust that is lost just before it is empty.

    An empty one gives no thrust.
    """

    full_v: Positive
    empty_v: Positive
    capacity_mah: Positive
    hover_current_a: Positive
    resistance_ohm: Nonnegative
    thrust_loss: Annotated[float, Field(ge=0.0, le=0.5)]

    @model_validator(mode="after")
    def _discharges(self) -> Self:
        """Refuse a battery that is not emptier at its lower voltage."""
        if self.empty_v >= self.full_v:
            message = f"{self.empty_v:g} V is not below full_v, {self.full_v:g} V"
            raise KeyFaultError("empty_v", message)
        return self


class EstimatorNoise(Part):
    """A profile's estimator noise: first-order Gauss-Markov errors, and delay."""

    position_sigma_m: Pair
    position_time_constant_s: Positive
    velocity_sigma_m_s: Pair
    velocity_time_constant_s: Positive
    heading_sigma_deg: Nonnegative
    tilt_sigma_deg: Nonnegative
    heading_time_constant_s: Positive
    delay_s: Annotated[float, Field(ge=0.0, le=0.2)]


class MotionCapture(Part):
    """A profile's motion capture: white noise, rate and latency."""

    rate_hz: Annotated[int, Field(ge=1, le=250)]
    position_sigma_m: Pair
    attitude_sigma_deg: Nonnegative
    latency_s: Nonnegative


class CameraFaults(Part):
    """A profile's camera faults.

    noise_std and offset in grey levels of 8 bits, gain a factor. exposure_s: open shutter, blurs
    with motion. latency_s: from the middle of the exposure to delivery, plus or minus jitter_s
    (standard deviation).
    """

    noise_std: Nonnegative
    gain: Positive
    offset: Annotated[float, Field(ge=-255.0, le=255.0)]
    exposure_s: Nonnegative
    latency_s: Nonnegative
    jitter_s: Nonnegative


class VehicleClock(Part):
    """A profile's autopilot clock: its reading when the vehicle starts, and its drift."""

    boot_offset_s: Nonnegative
    drift_ppm: Annotated[float, Field(ge=-500.0, le=500.0)]


def _inertia_key(axis: str) -> str:
    return f"inertia_{axis}_kg_m2"


class AirframeNumbers(Part):
    """A profile's airframe; fields and defaults, the paper's drone, as in `Airframe`."""

    mass_kg: Positive = 0.5
    inertia_xx_kg_m2: Positive = 2.32e-3
    inertia_yy_kg_m2: Positive = 2.32e-3
    inertia_zz_kg_m2: Positive = 4.0e-3
    arm_m: Positive = 0.175
    torque_per_thrust_m: Positive = 0.0245
    max_thrust_n: Positive = 2.7
    drag_area_m2: tuple[Nonnegative, Nonnegative, Nonnegative] = (0.010, 0.010, 0.020)
    linear_drag_n_s_m: Nonnegative = 0.0
    angular_damping_n_m_s: Nonnegative = 0.0006

    @model_validator(mode="after")
    def _can_fly(self) -> Self:
        """Refuse an airframe that its motors do not lift, or that is none of a quadrotor."""
        if self.mass_kg > _HEAVIEST_KG:
            message = f"{self.mass_kg:g} kg is no quadrotor: at most {_HEAVIEST_KG:g} kg"
            raise KeyFaultError("mass_kg", message)
        if self.arm_m > _LONGEST_ARM_M:
            message = f"{self.arm_m:g} m is no quadrotor: at most {_LONGEST_ARM_M:g} m"
            raise KeyFaultError("arm_m", message)
        most_kg_m2 = self.mass_kg * (_FAR_ARMS * self.arm_m) ** 2
        for key in ("inertia_xx_kg_m2", "inertia_yy_kg_m2", "inertia_zz_kg_m2"):
            if getattr(self, key) > most_kg_m2:
                message = f"{getattr(self, key):g} kg m² is too much for {self.mass_kg:g} kg and "
                message += f"arms of {self.arm_m:g} m: at most {most_kg_m2:.2g} kg m²"
                raise KeyFaultError(key, message)
        self._bears_its_motors()
        weight_n = self.mass_kg * _G_M_S2
        if _MOTORS * self.max_thrust_n <= weight_n:
            message = f"{_MOTORS} x {self.max_thrust_n} N do not lift {self.mass_kg:g} kg"
            raise KeyFaultError("max_thrust_n", f"{message} ({weight_n:.1f} N)")
        return self

    def _bears_its_motors(self) -> None:
        """Refuse less inertia than the motors alone have: such a body flips. Raises KeyFaultError.

        Of four motors at 45 degrees to roll and pitch, half of the arm's square counts there.
        """
        motors_kg = _MOTORS * self.max_thrust_n / (_THRUST_PER_MOTOR_WEIGHT * _G_M_S2)
        for axis, share in _USUAL_SHARES.items():
            key = _inertia_key(axis)
            given_kg_m2: float = getattr(self, key)
            least_kg_m2 = motors_kg * self.arm_m**2 * (1.0 if axis == "zz" else 0.5)
            if given_kg_m2 < least_kg_m2:
                usual_kg_m2 = share * self.mass_kg * self.arm_m**2
                message = f"{given_kg_m2:g} kg m² is less than motors of {self.max_thrust_n:g} N on"
                message += f" arms of {self.arm_m:g} m have alone ({least_kg_m2:.2g}): set {key} "
                message += f"too, usually about {share:g} mass x arm², {usual_kg_m2:.2g} kg m²"
                raise KeyFaultError(key, message)

    def unusual(self) -> Iterator[str]:
        """Yield in words each inertia that is far from that of quadrotors of its mass and arms."""
        for axis, (least, most) in _PUBLISHED_SHARES.items():
            given_kg_m2: float = getattr(self, _inertia_key(axis))
            whole_kg_m2 = self.mass_kg * self.arm_m**2
            share = given_kg_m2 / whole_kg_m2
            if not least / _UNUSUAL <= share <= most * _UNUSUAL:
                usual_kg_m2 = _USUAL_SHARES[axis] * whole_kg_m2
                yield (
                    f"airframe.inertia_{axis}_kg_m2 of {given_kg_m2:g} is {share:.2g} x mass x "
                    f"arm², published quadrotors have {least:g} to {most:g}: usually about "
                    f"{usual_kg_m2:.2g} kg m² for {self.mass_kg:g} kg on arms of {self.arm_m:g} m"
                )

    @property
    def motor_span_m(self) -> float:
        """Return the distance of two neighbouring motors, hub to hub."""
        return self.arm_m * math.sqrt(2.0)


class Profile(Part):
    """A profile of an embedded vehicle and its place.

    sensors: of lidars, GPS, IMU and others: `ideal` has the ranges of their data sheets and no
    noise; `datasheet` adds their noise. max_touchdown_m_s: the fastest that it may sink as it
    lands; by default 1 m/s: autopilots land at 0.7 (PX4's MPC_LAND_SPEED) and 0.5 m/s (ArduCopter's
    LAND_SPEED).
    """

    schema_: Literal["wil/profile/1"] = Field(alias="schema")
    description: str
    airframe: AirframeNumbers | None = None
    air: AirMovement
    motors: Motors
    battery: Battery
    estimator: EstimatorNoise
    mocap: MotionCapture
    camera: CameraFaults
    clock: VehicleClock
    sensors: Literal["ideal", "datasheet"] = "ideal"
    max_touchdown_m_s: Positive = 1.0


def list_profiles() -> tuple[str, ...]:
    """Return the names of the profiles that come with the program."""
    return tuple(path.stem for path in profile_files())


def profile_files() -> list[Path]:
    """Return the files of the profiles that come with the program, sorted."""
    return sorted(_FOLDER.glob("*.yaml"))


def load_profile(name_or_path: str | Path, *, shown_as: str | None = None) -> Profile:
    """Return a profile by name, or from a YAML file. shown_as: what messages call the file.

    Raises ProfileError for an unknown name, and BadInput with the place of each fault for a file
    that is unreadable or wrong.
    """
    text = str(name_or_path)
    if text.endswith((".yaml", ".yml")):
        path = Path(text)
    elif text in list_profiles():
        path = _FOLDER / f"{text}.yaml"
    else:
        known = list_profiles()
        raise ProfileError(
            f"no profile {text!r}; there are {', '.join(known)}, or give a file",
            closest_word(text, known),
        )
    return check_document(_with_base(load_document(path, name=shown_as)), Profile)


def _with_base(document: Document) -> Document:
    """Return a profile's document; what it lacks comes from the profile that `base` names.

    Raises BadInput for an unknown base.
    """
    own = document.root.value
    if not isinstance(own, dict):
        return document
    if "base" not in own:
        return Document(document.path, _with_inertia(document.root, own))
    name, known = document.get(("base",)), list_profiles()
    if name not in known:
        message = f"{name!r} is no profile of the program; there are {', '.join(known)}"
        raise BadInput([document.problem(("base",), message, closest_word(str(name), known))])
    base = load_document(_FOLDER / f"{name}.yaml").root
    own = {key: entry for key, entry in own.items() if key != "base"}
    merged = _merged(base, mapping_node(own, document.root.place))
    return Document(document.path, _with_inertia(merged, own, base))


def _with_inertia(
    profile: YamlNode, own: Mapping[str, YamlEntry], base: YamlNode | None = None
) -> YamlNode:
    """Return a profile with the inertia that its own airframe leaves out.

    It is that of the base, or else of the paper's drone, at this mass and these arms: bodies of one
    shape have it in proportion to mass times arm².
    """
    parts = profile.value
    if not isinstance(parts, dict) or "airframe" not in own:
        return profile
    of_paper = {name: field.default for name, field in AirframeNumbers.model_fields.items()}
    its = {**of_paper, **_airframe_of(base)}
    place, given = own["airframe"].node.place, _airframe_of(mapping_node(dict(own), profile.place))
    ratio = 1.0
    for key, power in (("mass_kg", 1), ("arm_m", 2)):
        number = given.get(key, its[key])
        if not isinstance(number, int | float) or not 0.0 < number < _BEYOND_ANY:
            return profile  # `check` says what is wrong with it
        ratio *= (number / its[key]) ** power
    sized = {
        key: YamlEntry(place, YamlNode(its[key] * ratio, place))
        for key in map(_inertia_key, _USUAL_SHARES)
        if key not in given
    }
    airframe = parts["airframe"]
    if not isinstance(airframe.node.value, dict):
        return profile
    whole = mapping_node({**airframe.node.value, **sized}, airframe.node.place)
    return mapping_node({**parts, "airframe": YamlEntry(airframe.key, whole)}, profile.place)


def _airframe_of(profile: YamlNode | None) -> dict[str, Any]:
    """Return the numbers of a profile's airframe; empty without one."""
    parts = None if profile is None else profile.value
    if not isinstance(parts, dict) or "airframe" not in parts:
        return {}
    given = parts["airframe"].node.value
    return {key: one.node.value for key, one in given.items()} if isinstance(given, dict) else {}


def _merged(base: YamlNode, own: YamlNode) -> YamlNode:
    """Return a node with the values of another one that it lacks, at every depth."""
    if not isinstance(base.value, dict) or not isinstance(own.value, dict):
        return own
    inside = {
        key: YamlEntry(entry.key, _merged(base.value[key].node, entry.node))
        if key in base.value
        else entry
        for key, entry in own.value.items()
    }
    return mapping_node({**base.value, **inside}, own.place)
