"""The settings of an embedded vehicle's process, which it gets as one JSON argument."""

import math
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig, Physics
from wil_campaign.vehicles.embedded.profile import load_profile
from wil_campaign.worlds.frames import Pose


class _Part(BaseModel):
    """The base of the parts of an embedded process's settings."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Start(_Part):
    """The start pose in an embedded process's settings."""

    north_m: float = 0.0
    east_m: float = 0.0
    up_m: float = 0.0
    yaw_deg: float = 0.0


class ContactWorldSettings(_Part):
    """The settings of the contact world: `module:function`, called with the argument."""

    use: str = Field(pattern=r"^[\w.]+:\w+$")
    argument: str = ""


class ProcessSettings(_Part):
    """The settings of an embedded vehicle's process, with its link and feed.

    link: a link string, seen from the vehicle (udpout://127.0.0.1:14540). feed_host, feed_port:
    where truth and motion capture are sent; 0 for no feed, or that of an inherited socket. speed:
    how many times real time its clock runs, if the machine can. end_with_stdin: end when the pipe
    on stdin closes. end_with_parent: end when the process that started it ends; false where other
    processes hold the pipe as well, so that the failsafes can act. running_s: for how long the
    autopilot has been on when its link opens; ArduCopter needs 42 s to be ready. boot_unix_us: the
    time of day at boot, for its GPS. print_texts: print STATUSTEXTs and acknowledgements to stderr.
    faults: texts of `parse_fault`; their times count from the opening of the link.
    """

    autopilot: str
    link: str
    seed: int = Field(ge=0)
    physics: Physics = "jsbsim"
    profile: str = "nominal"
    source: Literal["real", "twin"] = "real"
    system_id: int = Field(default=1, ge=1, le=255)
    start: Start = Start()
    latitude_deg: float = 47.397742
    longitude_deg: float = 8.545594
    altitude_m: float = 488.0
    parameters: dict[str, float] = {}
    full_streams: bool = False
    uid: int | None = None
    boot_unix_us: int | None = None
    feed_host: str = "127.0.0.1"
    feed_port: int = Field(default=0, ge=0, le=65535)
    truth_hz: float = Field(default=50.0, gt=0.0, le=250.0)
    contact_world: ContactWorldSettings | None = None
    speed: float = Field(default=1.0, gt=0.0, le=100.0)
    running_s: float = Field(default=0.0, ge=0.0, le=86_400.0)
    end_with_stdin: bool = False
    end_with_parent: bool = True
    print_texts: bool = False
    never_ready: bool = False
    refuse_arm: str | None = None
    faults: tuple[str, ...] = ()

    @field_validator("autopilot")
    @classmethod
    def _is_registered(cls, name: str) -> str:
        autopilot_named(name)
        return name

    def config(self) -> EmbeddedConfig:
        """Return the vehicle's config. Raises ProfileError, BadInput."""
        start = self.start
        return EmbeddedConfig(
            autopilot=self.autopilot,
            physics=self.physics,
            profile=load_profile(self.profile),
            source=self.source,
            system_id=self.system_id,
            start=Pose.of(
                start.north_m, start.east_m, start.up_m, yaw_rad=math.radians(start.yaw_deg)
            ),
            latitude_deg=self.latitude_deg,
            longitude_deg=self.longitude_deg,
            altitude_m=self.altitude_m,
            parameters=self.parameters,
            full_streams=self.full_streams,
            uid=self.uid,
            boot_unix_us=self.boot_unix_us,
            running_s=self.running_s,
            never_ready=self.never_ready,
            refuse_arm=self.refuse_arm,
        )
