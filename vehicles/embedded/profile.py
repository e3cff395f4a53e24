"""Profiles: what a vehicle and a place add to a flight, as data with a source for each number.

A profile describes a vehicle and a place; it is never tuned per campaign.
"""

from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

_FOLDER = Path(__file__).parent / "profiles"

Nonnegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Pair = tuple[Nonnegative, Nonnegative]
"""Horizontal and vertical, each axis."""


class ProfileError(ValueError):
    """A profile that cannot be had; says which, and what is wrong in it."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class AirMovement(_Part):
    """First-order Gauss-Markov movement of the air, NED, of zero mean."""

    sigma_m_s: tuple[Nonnegative, Nonnegative, Nonnegative]
    time_constant_s: Positive


class Motors(_Part):
    """Lag of thrust behind its command, and the spread (standard deviation) between motors."""

    lag_s: Positive
    spread: Annotated[float, Field(ge=0.0, le=0.2)]


class Battery(_Part):
    """A pack that sags under load; `thrust_loss`: part of thrust that is gone when empty."""

    full_v: Positive
    empty_v: Positive
    capacity_mah: Positive
    hover_current_a: Positive
    resistance_ohm: Nonnegative
    thrust_loss: Annotated[float, Field(ge=0.0, le=0.5)]


class EstimatorNoise(_Part):
    """First-order Gauss-Markov errors of the vehicle's own estimate, and its delay."""

    position_sigma_m: Pair
    position_time_constant_s: Positive
    velocity_sigma_m_s: Pair
    velocity_time_constant_s: Positive
    heading_sigma_deg: Nonnegative
    tilt_sigma_deg: Nonnegative
    heading_time_constant_s: Positive
    delay_s: Annotated[float, Field(ge=0.0, le=0.2)]


class MotionCapture(_Part):
    """White noise, rate and latency of the motion-capture feed."""

    rate_hz: Annotated[int, Field(ge=1, le=250)]
    position_sigma_m: Pair
    attitude_sigma_deg: Nonnegative
    latency_s: Nonnegative


class CameraFaults(_Part):
    """What the camera does to a picture.

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


class VehicleClock(_Part):
    """The autopilot's clock: its reading when the vehicle starts, and its drift."""

    boot_offset_s: Nonnegative
    drift_ppm: Annotated[float, Field(ge=-500.0, le=500.0)]


class Profile(_Part):
    """A vehicle and a place.

    sensors: what lidars, GPS, IMU and the like are: `ideal`, with the reach of their data sheets
    and no noise; or `datasheet`, with their noise.
    """

    schema_: Literal["wil/profile/1"] = Field(alias="schema")
    description: str
    air: AirMovement
    motors: Motors
    battery: Battery
    estimator: EstimatorNoise
    mocap: MotionCapture
    camera: CameraFaults
    clock: VehicleClock
    sensors: Literal["ideal", "datasheet"] = "ideal"


def list_profiles() -> tuple[str, ...]:
    """Return the names of the profiles that come with the program."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))


def load_profile(name_or_path: str | Path) -> Profile:
    """Return a profile by name, or from a YAML file. Raises ProfileError."""
    text = str(name_or_path)
    path = Path(text) if text.endswith((".yaml", ".yml")) else _FOLDER / f"{text}.yaml"
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        known = ", ".join(list_profiles())
        raise ProfileError(f"no profile {text!r}; there are {known}, or give a file") from error
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ProfileError(f"profile {text!r} cannot be read: {error}") from error
    try:
        return Profile.model_validate(data)
    except ValidationError as error:
        faults = "; ".join(
            f"{'.'.join(str(part) for part in fault['loc'])}: {fault['msg']}"
            for fault in error.errors()
        )
        raise ProfileError(f"profile {text!r}: {faults}") from error
