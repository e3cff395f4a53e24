"""The base of autopilot strategies; pure: MAVLink messages in and out, no sockets, no clock."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar, Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.estimator_losses import EstimatorLosses
from wil_campaign.vehicles.autopilots.failsafes import AutopilotFailsafes
from wil_campaign.vehicles.autopilots.ground_truth import GroundTruth
from wil_campaign.vehicles.autopilots.map_projections import MapProjection
from wil_campaign.vehicles.autopilots.readiness import Readiness, ReadinessRules
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.worlds.frames import Vec3

FenceAction = Literal["report", "hold", "land", "rtl"]
"""What an autopilot does on a breach of its own fence."""


class FlightMode(Enum):
    """A flight mode by its meaning, whatever the autopilot calls it."""

    HOLD = "hold"
    TAKEOFF = "takeoff"
    GUIDED = "guided"
    """Follows setpoints over MAVLink: OFFBOARD on PX4, GUIDED on ArduCopter."""
    LAND = "land"
    RTL = "rtl"
    MISSION = "mission"
    PILOT = "pilot"
    """A mode that a pilot flies by sticks."""
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class MavlinkTarget:
    """The target autopilot of a message: MAVLink system and component id."""

    system: int
    component: int = 1


@dataclass(frozen=True, slots=True)
class MessageRate:
    """A line of an autopilot's telemetry plan; one that is not `required` may be missing."""

    message_id: int
    rate_hz: float
    required: bool = True


@dataclass(frozen=True, slots=True)
class TelemetryRates:
    """The telemetry rates requested from an autopilot, in Hz."""

    position_hz: float = 50.0
    attitude_hz: float = 50.0
    state_hz: float = 5.0
    """Landed state: the time off the ground is known to 1 / state_hz."""
    status_hz: float = 2.0
    """System and estimator status, global position."""
    home_hz: float = 0.5
    ground_speed_hz: float = 0.0
    """Of its GPS receivers; 0: not requested."""
    truth_hz: float = 0.0
    """Of its simulator's ground truth; 0: not requested."""
    accuracy_hz: float = 0.0
    """Of its estimator's covariance; 0: not requested."""
    magnetometer_hz: float = 0.0
    """Of its magnetometer; 0: not requested."""
    sensors: tuple[MessageRate, ...] = ()
    """Of messages with readings of its sensors."""


def command_long(target: MavlinkTarget, command: int, *parameters: float) -> Any:
    """Return a COMMAND_LONG to an autopilot; parameters that are not given are 0."""
    padded = (*parameters, *([0.0] * (7 - len(parameters))))
    return mavlink.MAVLink_command_long_message(
        target.system, target.component, command, 0, *padded
    )


def own_heartbeat() -> Any:
    """Return our heartbeat to the autopilot: a GCS's, else PX4 sends no STATUSTEXT."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    )


def has_board_ids(version: Any) -> bool:
    """Return whether an AUTOPILOT_VERSION has a board's ids, which no simulation has.

    ArduPilot for boards with Linux (Navio2) has none either.
    """
    return bool(version.board_version or version.vendor_id)


def _with_sensors(
    plan: tuple[MessageRate, ...], sensors: Iterable[MessageRate]
) -> tuple[MessageRate, ...]:
    """Return a plan with the messages of sensors added; a message gets the higher of two rates."""
    lines = {line.message_id: line for line in plan}
    for line in sensors:
        known = lines.get(line.message_id, line)
        often_hz = max(known.rate_hz, line.rate_hz)
        lines[line.message_id] = replace(known, rate_hz=often_hz)
    return tuple(lines.values())


class Autopilot(ABC):
    """The strategy of one kind of autopilot: builds its messages, reads its replies.

    Messages are pymavlink objects (dialect ardupilotmega, v2), not yet packed. Positions and
    velocities are in the autopilot's own local NED frame.
    """

    name: ClassVar[str]
    """In campaigns."""
    label: ClassVar[str]
    """Its name in messages."""
    mav_autopilot: ClassVar[int]
    """MAV_AUTOPILOT of its heartbeat."""
    setpoint_rate_hz: ClassVar[float]
    """The rate of setpoints that keeps it in its guided mode."""
    streams_before_guided_s: ClassVar[float]
    """How long setpoints must stream before it accepts the guided mode; 0 for not at all."""
    arming_mode: ClassVar[FlightMode]
    """The mode to arm in, from which a takeoff command is accepted at once."""
    takeoff_modes: ClassVar[tuple[FlightMode, ...]]
    """The modes that it enters by itself after a takeoff command."""
    spool_s: ClassVar[float]
    """How long after arming its motors spool up, before it can take off."""
    liftoff_s: ClassVar[float]
    """The time from the takeoff command until it begins to climb, with motors spooled up."""
    embedded_liftoff_s: ClassVar[float]
    """The same of the embedded vehicle of this autopilot."""
    embedded_parameters: ClassVar[Path]
    """The file of the parameters of the embedded vehicle."""
    embedded_link: ClassVar[str]
    """Its end of the link to other programs, as the firmware has it by default."""
    takeoff_needs_amsl: ClassVar[bool]
    """Whether the takeoff command carries a height above mean sea level."""
    parameters_bytewise: ClassVar[bool]
    """Whether PARAM_VALUE holds integers as their bytes rather than as a float."""
    changes_mode_on_disarm: ClassVar[bool]
    """Whether it leaves LAND or RTL by itself once disarmed."""
    refusal_prefixes: ClassVar[tuple[str, ...]]
    """The prefixes of STATUSTEXTs that explain why it does not arm."""
    readiness_rules: ClassVar[ReadinessRules]
    estimator_message_id: ClassVar[int]
    """Of the message with its estimator's status flags."""
    accuracy_message_id: ClassVar[int | None]
    """Of the message with its estimator's covariance in metres; None when it sends none."""
    truth_message_id: ClassVar[int]
    """Of the message with its simulator's ground truth."""
    magnetometer_message_id: ClassVar[int]
    """Of the message with its magnetometer's field in body axes."""
    simulation_message_id: ClassVar[int | None] = None
    """Of a message that only its simulation sends; None where its AUTOPILOT_VERSION tells."""
    guided_name: ClassVar[str]
    """Its own name of the mode GUIDED."""
    motion_parameters: ClassVar[tuple[str, ...]]
    """Prefixes of the parameters that say how the vehicle moves."""
    fallback_modes: ClassVar[frozenset[str]]
    """Its names of the pilot's modes that it enters by itself when it can no longer be guided."""
    heeds_pace: ClassVar[bool] = False
    """Whether its own simulator's pace can be set while it flies."""
    frame_parameters: ClassVar[tuple[str, ...]]
    """The parameters that tell its frame, beside the MAV_TYPE of its heartbeat."""
    parameters_digest: ClassVar[str | None] = None
    """The pseudo-parameter by which it tells a digest of all of its parameters; None: by none."""
    restless_parameters: ClassVar[tuple[str, ...]] = ()
    """Patterns of parameters that it changes by itself, as counters and what a boot measures."""
    failsafes: ClassVar[AutopilotFailsafes]
    oldest_version: ClassVar[tuple[int, int]]
    """The oldest firmware, major and minor, that supports what the strategy uses."""
    log_suffix: ClassVar[str]
    logs_numbered_in_order: ClassVar[bool] = False
    """Whether a later log has a higher number."""
    most_fence_items: ClassVar[int | None] = None
    """How many corners and circles of fences it stores; None: unknown."""
    missions_begin_at_home: ClassVar[bool] = False
    """Whether item 0 of a mission is home."""
    imu_message: ClassVar[str] = "HIGHRES_IMU"
    """By which it sends what its IMU measures; RAW_IMU of no other has a known unit."""
    unsent_messages: ClassVar[Mapping[str, str]] = {}
    """Messages with readings that it never sends, with the reason and the remedy."""

    @abstractmethod
    def mode_of(self, custom_mode: int) -> FlightMode:
        """Return our mode for the autopilot's HEARTBEAT."""

    @abstractmethod
    def mode_name(self, custom_mode: int) -> str:
        """Return the autopilot's own name of the mode ("OFFBOARD", "BRAKE")."""

    @abstractmethod
    def set_mode(self, target: MavlinkTarget, mode: FlightMode) -> Any:
        """Return the autopilot's MAV_CMD_DO_SET_MODE for HOLD, GUIDED, LAND, RTL or MISSION.

        Raises ValueError for other modes.
        """

    @abstractmethod
    def takeoff(
        self, target: MavlinkTarget, *, altitude_m: float, ground_amsl_m: float | None
    ) -> Any:
        """Return the autopilot's NAV_TAKEOFF to `altitude_m` above the ground.

        ground_amsl_m: the autopilot's own estimate of that ground above mean sea level. Raises
        VehicleError when the autopilot needs it and it is None.
        """

    def least_takeoff_parameter(self, version: tuple[int, int, int]) -> str | None:
        """Return the parameter below whose value, in metres, no takeoff command is obeyed."""
        del version
        return None

    @abstractmethod
    def is_simulation(self, version: Any, system_id: int, *, shows_it: bool) -> bool:
        """Return whether a vehicle is a simulation, by its AUTOPILOT_VERSION; unknown: hardware.

        shows_it: whether it has sent its `simulation_message_id`.
        """

    @abstractmethod
    def fence_parameters(
        self, *, has_areas: bool, ceiling_m: float | None, action: FenceAction
    ) -> dict[str, int | float]:
        """Return the parameters that make it enforce a fence, in the order to set.

        ceiling_m: above home; None for none. Bounds come before the parameters that enable them, so
        that none is breached in between in flight; restored in reverse order, the fence is off
        before its bounds change.
        """

    @abstractmethod
    def _heading_mask(self, yaw_rad: float | None, yaw_rate_rad_s: float | None) -> int:
        """Return the ignore bits of yaw and yaw rate for a setpoint; without both it does not turn.

        yaw_rad, yaw_rate_rad_s: None for a value that the setpoint does not have; never both set.
        """

    @abstractmethod
    def ground_truth(self, message: Any) -> GroundTruth:
        """Return the ground truth in its simulator's message. Raises GroundTruthError."""

    @abstractmethod
    def projection(self, latitude_deg: float, longitude_deg: float) -> MapProjection:
        """Return its simulator's map projection around a place."""

    def telemetry_plan(self, rates: TelemetryRates) -> tuple[MessageRate, ...]:
        """Return the messages to request from the autopilot, and how often."""
        gps = tuple(
            MessageRate(one, rates.ground_speed_hz, required=False)
            for one in (mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, mavlink.MAVLINK_MSG_ID_GPS2_RAW)
        )
        truth = MessageRate(self.truth_message_id, rates.truth_hz, required=False)
        exact = self.accuracy_message_id
        magnetometer = MessageRate(
            self.magnetometer_message_id, rates.magnetometer_hz, required=False
        )
        plan = (
            MessageRate(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, rates.position_hz),
            MessageRate(mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, rates.attitude_hz),
            MessageRate(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, rates.state_hz),
            MessageRate(mavlink.MAVLINK_MSG_ID_SYS_STATUS, rates.status_hz),
            MessageRate(self.estimator_message_id, rates.status_hz),
            MessageRate(
                mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, rates.status_hz, required=False
            ),
            MessageRate(mavlink.MAVLINK_MSG_ID_HOME_POSITION, rates.home_hz, required=False),
            *(gps if rates.ground_speed_hz > 0.0 else ()),
            *((truth,) if rates.truth_hz > 0.0 else ()),
            *(
                (MessageRate(exact, rates.accuracy_hz, required=False),)
                if exact is not None and rates.accuracy_hz > 0.0
                else ()
            ),
            *((magnetometer,) if rates.magnetometer_hz > 0.0 else ()),
        )
        return _with_sensors(plan, rates.sensors)

    def velocity_setpoint(
        self,
        target: MavlinkTarget,
        *,
        t_boot_ms: int,
        velocity_ned_m_s: Vec3,
        yaw_rad: float | None = None,
        yaw_rate_rad_s: float | None = None,
    ) -> Any:
        """Return the autopilot's SET_POSITION_TARGET_LOCAL_NED of a velocity.

        Neither yaw nor yaw rate keeps the present heading. Raises ValueError for both.
        """
        if yaw_rad is not None and yaw_rate_rad_s is not None:
            raise ValueError("a setpoint has a heading or a heading rate, not both")
        heading_mask = self._heading_mask(yaw_rad, yaw_rate_rad_s)
        return local_target_message(
            target,
            t_boot_ms=t_boot_ms,
            type_mask=IGNORE_POSITION | IGNORE_ACCELERATION | heading_mask,
            velocity_ned_m_s=velocity_ned_m_s,
            yaw_rad=yaw_rad or 0.0,
            yaw_rate_rad_s=yaw_rate_rad_s or 0.0,
        )

    def position_setpoint(
        self,
        target: MavlinkTarget,
        *,
        t_boot_ms: int,
        position_ned_m: Vec3,
        yaw_rad: float | None = None,
    ) -> Any:
        """Return the autopilot's SET_POSITION_TARGET_LOCAL_NED of a position."""
        return local_target_message(
            target,
            t_boot_ms=t_boot_ms,
            type_mask=IGNORE_VELOCITY | IGNORE_ACCELERATION | self._heading_mask(yaw_rad, None),
            position_ned_m=position_ned_m,
            yaw_rad=yaw_rad or 0.0,
        )

    def arm(self, target: MavlinkTarget) -> Any:
        """Return the command that arms, with all of the autopilot's checks."""
        return command_long(target, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)

    def disarm(self, target: MavlinkTarget) -> Any:
        """Return the command that disarms; an autopilot in the air refuses it."""
        return command_long(target, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)

    def terminate(self, target: MavlinkTarget) -> Any:
        """Return the autopilot's command that stops the motors at once, in the air too."""
        return command_long(target, mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0)

    def set_simulation_pace(self, target: MavlinkTarget, times_real_time: float) -> Any:
        """Return the message that sets the pace of its simulator; only where `heeds_pace`."""
        raise NotImplementedError(f"the pace of {self.label} can only be set at its start")

    def request_interval(self, target: MavlinkTarget, rate: MessageRate) -> Any:
        """Return MAV_CMD_SET_MESSAGE_INTERVAL for one line of the autopilot's plan."""
        interval_us = round(1e6 / rate.rate_hz) if rate.rate_hz > 0 else -1
        return command_long(
            target, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(rate.message_id), float(interval_us)
        )

    def request_message(self, target: MavlinkTarget, message_id: int) -> Any:
        """Return MAV_CMD_REQUEST_MESSAGE for one message of the autopilot."""
        return command_long(target, mavlink.MAV_CMD_REQUEST_MESSAGE, float(message_id))

    def request_checks(self, target: MavlinkTarget) -> Any:
        """Return the command that makes the autopilot report failing pre-arm checks."""
        return command_long(target, mavlink.MAV_CMD_RUN_PREARM_CHECKS)

    def readiness(self) -> Readiness:
        """Return a new tracker of the autopilot's readiness to arm and take off."""
        return Readiness(self.readiness_rules)

    def estimator_losses(self) -> EstimatorLosses:
        """Return a new tracker of what the autopilot's estimator loses in flight."""
        rules = self.readiness_rules
        return EstimatorLosses(estimator_message=rules.estimator_message, glitch=rules.glitch)

    def refusal_reasons(self, texts: Iterable[str]) -> tuple[str, ...]:
        """Return the autopilot's STATUSTEXT reasons against arming, without prefixes."""
        reasons: dict[str, None] = {}
        for text in texts:
            for prefix in self.refusal_prefixes:
                if text.startswith(prefix):
                    reasons[text.removeprefix(prefix).strip()] = None
                    break
        return tuple(reasons)

    def _needed_amsl(self, ground_amsl_m: float | None) -> float:
        if ground_amsl_m is None:
            raise VehicleError(
                f"{self.label} takes off to a height above sea level, which is unknown: it sent "
                "neither GLOBAL_POSITION_INT nor HOME_POSITION; wait for its GPS"
            )
        return ground_amsl_m


IGNORE_POSITION = 0b111
IGNORE_VELOCITY = 0b111 << 3
IGNORE_ACCELERATION = 0b111 << 6
IGNORE_YAW = 1 << 10
IGNORE_YAW_RATE = 1 << 11
"""POSITION_TARGET_TYPEMASK of SET_POSITION_TARGET_LOCAL_NED."""


def local_target_message(
    target: MavlinkTarget,
    *,
    t_boot_ms: int,
    type_mask: int,
    position_ned_m: Vec3 = (0.0, 0.0, 0.0),
    velocity_ned_m_s: Vec3 = (0.0, 0.0, 0.0),
    yaw_rad: float = 0.0,
    yaw_rate_rad_s: float = 0.0,
) -> Any:
    """Return an autopilot's SET_POSITION_TARGET_LOCAL_NED with this type mask."""
    return mavlink.MAVLink_set_position_target_local_ned_message(
        t_boot_ms & 0xFFFFFFFF,
        target.system,
        target.component,
        mavlink.MAV_FRAME_LOCAL_NED,
        type_mask,
        *position_ned_m,
        *velocity_ned_m_s,
        0.0,
        0.0,
        0.0,
        yaw_rad,
        yaw_rate_rad_s,
    )
