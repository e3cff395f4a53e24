"""ArduPilot's ArduCopter 4.3 and later.

Modes: ArduCopter/mode.h (Mode::Number). Parameters: ArduCopter/Parameters.cpp and events.cpp.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.ardupilot.simulated_truth import ArduPilotProjection, read_sim_state
from wil_campaign.vehicles.autopilots.autopilot import (
    IGNORE_YAW,
    IGNORE_YAW_RATE,
    Autopilot,
    FenceAction,
    FlightMode,
    MavlinkTarget,
    command_long,
    has_board_ids,
)
from wil_campaign.vehicles.autopilots.failsafes import (
    OWN_SYSTEM_ID,
    SILENT_S,
    AutopilotFailsafes,
    FailsafeRule,
    ReturnAltitudeParameter,
    ReturnsBy,
)
from wil_campaign.vehicles.autopilots.ground_truth import GroundTruth
from wil_campaign.vehicles.autopilots.readiness import ReadinessRules

_SETTABLE: dict[FlightMode, int] = {
    # BRAKE stops and holds by itself and ignores sticks and late setpoints. LOITER sinks when no
    # remote control holds the throttle at its centre; GUIDED would follow setpoints.
    FlightMode.HOLD: 17,
    FlightMode.GUIDED: 4,
    FlightMode.LAND: 9,
    FlightMode.RTL: 6,
    FlightMode.MISSION: 3,
}
_MODES: dict[int, tuple[str, FlightMode]] = {
    0: ("STABILIZE", FlightMode.PILOT),
    1: ("ACRO", FlightMode.PILOT),
    2: ("ALT_HOLD", FlightMode.PILOT),
    3: ("AUTO", FlightMode.MISSION),
    4: ("GUIDED", FlightMode.GUIDED),
    5: ("LOITER", FlightMode.PILOT),
    6: ("RTL", FlightMode.RTL),
    7: ("CIRCLE", FlightMode.PILOT),
    9: ("LAND", FlightMode.LAND),
    11: ("DRIFT", FlightMode.PILOT),
    13: ("SPORT", FlightMode.PILOT),
    14: ("FLIP", FlightMode.PILOT),
    15: ("AUTOTUNE", FlightMode.PILOT),
    16: ("POSHOLD", FlightMode.PILOT),
    17: ("BRAKE", FlightMode.HOLD),
    18: ("THROW", FlightMode.OTHER),
    19: ("AVOID_ADSB", FlightMode.OTHER),
    20: ("GUIDED_NOGPS", FlightMode.OTHER),
    21: ("SMART_RTL", FlightMode.RTL),
    22: ("FLOWHOLD", FlightMode.PILOT),
    23: ("FOLLOW", FlightMode.OTHER),
    24: ("ZIGZAG", FlightMode.PILOT),
    25: ("SYSTEMID", FlightMode.PILOT),
    26: ("AUTOROTATE", FlightMode.OTHER),
    27: ("AUTO_RTL", FlightMode.RTL),
    28: ("TURTLE", FlightMode.PILOT),
}

_LAND = 5
"""Of FS_GCS_ENABLE."""
_CONTINUE_WITHOUT_GCS = 1 << 4
"""GCS_CONTINUE_IF_PILOT_CONTROL of FS_OPTIONS, set by default: a lost ground station changes
nothing in modes that are no autopilot's by mode.h, such as BRAKE, in which the guard holds."""
_RETURNS = frozenset({1, 2, 3, 4, 6})
"""Values of FS_GCS_ENABLE."""
_TO_LANDING_START = 6
"""FS_GCS_ENABLE: to DO_LAND_START or DO_RETURN_PATH_START of the mission, else RTL."""


def _ways_of_return(values: Mapping[str, float]) -> frozenset[ReturnsBy]:
    """Return the places besides home to which ArduCopter's RTL may fly (AP_Rally.cpp)."""
    landing = values["FS_GCS_ENABLE"] == _TO_LANDING_START
    return frozenset({"rally", "landing"}) if landing else frozenset({"rally"})


_FAILSAFES = AutopilotFailsafes(
    # By default ArduCopter hovers on link loss.
    on_silence={
        "FS_GCS_ENABLE": float(_LAND),
        "FS_GCS_TIMEOUT": SILENT_S,
        "FS_OPTIONS": 0.0,
        "MAV_GCS_SYSID": float(OWN_SYSTEM_ID),
    },
    rules=(
        FailsafeRule(
            names=("FS_GCS_ENABLE",),
            wanted=_LAND,
            sound=frozenset({1, 2, 3, 4, 5, 6}),
            wrong="on link loss it would hover until its battery is empty",
        ),
        FailsafeRule(
            names=("FS_GCS_TIMEOUT",),
            longest_s=30.0,
            wrong="it would take too long to detect a link loss",
        ),
        FailsafeRule(
            names=("FS_OPTIONS",),
            forbidden=_CONTINUE_WITHOUT_GCS,
            wrong="it would ignore a link loss in BRAKE, in which the guard holds; take "
            f"{_CONTINUE_WITHOUT_GCS} (continue in pilot controlled modes) off it",
        ),
        FailsafeRule(
            names=("MAV_GCS_SYSID", "SYSID_MYGCS"),
            wanted=OWN_SYSTEM_ID,
            sound=frozenset({OWN_SYSTEM_ID}),
            wrong=f"it expects another ground station's heartbeats, not ours ({OWN_SYSTEM_ID})",
        ),
        FailsafeRule(
            names=("RTL_ALT_FINAL", "RTL_ALT_FINAL_M"),
            most=0.0,
            wrong="on link loss it would return, and hover there until its battery is empty",
            is_optional=True,
            where=("FS_GCS_ENABLE", _RETURNS),
        ),
        FailsafeRule(
            names=("FS_EKF_ACTION",),
            wanted=1,
            sound=frozenset({1, 3}),
            wrong="without a position it would not land, but wait for a pilot",
            is_optional=True,
        ),
    ),
    return_altitudes=(
        ReturnAltitudeParameter("RTL_ALT", 0.01),
        ReturnAltitudeParameter("RTL_ALT_M", 1.0),
    ),
    returning={"FS_GCS_ENABLE": _RETURNS},
    ways=_ways_of_return,
    rally_limit="RALLY_LIMIT_KM",
)
_FENCE_ACTIONS: dict[FenceAction, int] = {"report": 0, "rtl": 1, "land": 2, "hold": 4}
_ALTITUDE_BIT, _AREAS_BIT = 1, 4
"""FENCE_TYPE: the highest altitude; polygons and circles."""


class ArduCopter(Autopilot):
    """ArduCopter: arms and flies in GUIDED; heights are relative; stops 3 s after setpoints do."""

    name: ClassVar[str] = "ardupilot"
    label: ClassVar[str] = "ArduCopter"
    mav_autopilot: ClassVar[int] = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    # GUID_TIMEOUT is 3 s; at 10 Hz its own interpolation stays smooth.
    setpoint_rate_hz: ClassVar[float] = 10.0
    streams_before_guided_s: ClassVar[float] = 0.0
    # NAV_TAKEOFF over MAVLink is accepted in GUIDED only.
    arming_mode: ClassVar[FlightMode] = FlightMode.GUIDED
    takeoff_modes: ClassVar[tuple[FlightMode, ...]] = (FlightMode.GUIDED,)
    spool_s: ClassVar[float] = 2.0
    """The delay after arming, and MOT_SPOOL_TIME: before, a takeoff command waits (4.7)."""
    # Measured by our liftoff detector, minus spool_s, in flights of the gate with 4.7.
    liftoff_s: ClassVar[float] = 1.3
    embedded_liftoff_s: ClassVar[float] = 1.6
    embedded_parameters: ClassVar[Path] = Path(__file__).with_name("copter_parameters.yaml")
    embedded_link: ClassVar[str] = "tcpin://127.0.0.1:5760"
    takeoff_needs_amsl: ClassVar[bool] = False
    parameters_bytewise: ClassVar[bool] = False
    changes_mode_on_disarm: ClassVar[bool] = False
    refusal_prefixes: ClassVar[tuple[str, ...]] = ("PreArm:", "Arm:")
    readiness_rules: ClassVar[ReadinessRules] = ReadinessRules(
        estimator_message="EKF_STATUS_REPORT",
        forbidden_flags=mavlink.ESTIMATOR_CONST_POS_MODE | mavlink.EKF_UNINITIALIZED,
        needs_home=False,
        glitch=(mavlink.EKF_GPS_GLITCHING, "EKF_GPS_GLITCHING"),
    )
    estimator_message_id: ClassVar[int] = mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT
    # The "variances" of EKF_STATUS_REPORT are test ratios without a unit.
    accuracy_message_id: ClassVar[int | None] = None
    truth_message_id: ClassVar[int] = mavlink.MAVLINK_MSG_ID_SIM_STATE
    magnetometer_message_id: ClassVar[int] = mavlink.MAVLINK_MSG_ID_RAW_IMU
    # Under AP_SIM_ENABLED in GCS_Common.cpp.
    simulation_message_id: ClassVar[int | None] = mavlink.MAVLINK_MSG_ID_SIM_STATE
    guided_name: ClassVar[str] = "GUIDED"
    motion_parameters: ClassVar[tuple[str, ...]] = (
        "WPNAV_", "WP_", "LOIT_", "PILOT_", "ANGLE_MAX", "ATC_", "PSC_", "LAND_",
    )  # fmt: skip
    # FS_EKF_ACTION 2 (ekf_check.cpp); no failsafe of events.cpp enters another of them.
    fallback_modes: ClassVar[frozenset[str]] = frozenset({"ALT_HOLD"})
    heeds_pace: ClassVar[bool] = True
    frame_parameters: ClassVar[tuple[str, ...]] = ("FRAME_CLASS", "FRAME_TYPE")
    restless_parameters: ClassVar[tuple[str, ...]] = (
        "STAT_*",  # flights, runtime (AP_Stats.cpp)
        "*_GND_PRESS",  # of barometers, at each boot
        "INS_GYR*OFFS_?",  # of gyroscopes, at each boot (INS_GYR_CAL)
        "*_TOTAL",  # items of mission, fence and rally, which are no settings
    )
    failsafes: ClassVar[AutopilotFailsafes] = _FAILSAFES
    oldest_version: ClassVar[tuple[int, int]] = (4, 3)
    log_suffix: ClassVar[str] = ".bin"
    # Of 560 bytes (StorageManager.cpp, AC_PolyFence_loader::max_items); more on a memory card.
    most_fence_items: ClassVar[int] = 70
    logs_numbered_in_order: ClassVar[bool] = True
    missions_begin_at_home: ClassVar[bool] = True
    imu_message: ClassVar[str] = "RAW_IMU"
    unsent_messages: ClassVar[Mapping[str, str]] = {
        "OBSTACLE_DISTANCE": "ArduPilot sends no OBSTACLE_DISTANCE (its proximity sensor's sectors "
        "are DISTANCE_SENSOR messages): use tcp:// or an MCAP file"
    }

    def mode_of(self, custom_mode: int) -> FlightMode:
        """Return our mode for an ArduCopter HEARTBEAT."""
        return _MODES.get(custom_mode, ("", FlightMode.OTHER))[1]

    def mode_name(self, custom_mode: int) -> str:
        """Return ArduCopter's name of the mode."""
        return _MODES.get(custom_mode, (f"mode {custom_mode}", FlightMode.OTHER))[0]

    def set_mode(self, target: MavlinkTarget, mode: FlightMode) -> Any:
        """Return ArduCopter's DO_SET_MODE; raises ValueError for other modes."""
        if mode not in _SETTABLE:
            raise ValueError(f"{mode} is not a mode to set on ArduCopter")
        custom = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
        return command_long(target, mavlink.MAV_CMD_DO_SET_MODE, custom, float(_SETTABLE[mode]))

    def ground_truth(self, message: Any) -> GroundTruth:
        """Return the ground truth in a SIM_STATE. Raises GroundTruthError."""
        return read_sim_state(message)

    def projection(self, latitude_deg: float, longitude_deg: float) -> ArduPilotProjection:
        """Return ArduPilot's map projection around a place."""
        return ArduPilotProjection(latitude_deg, longitude_deg)

    def takeoff(
        self, target: MavlinkTarget, *, altitude_m: float, ground_amsl_m: float | None
    ) -> Any:
        """Return ArduCopter's NAV_TAKEOFF; its height is relative to the ground."""
        del ground_amsl_m
        unused = (0.0,) * 6
        return command_long(target, mavlink.MAV_CMD_NAV_TAKEOFF, *unused, altitude_m)

    def set_simulation_pace(self, target: MavlinkTarget, times_real_time: float) -> Any:
        """Return the PARAM_SET of SIM_SPEEDUP, which SITL heeds in flight."""
        return mavlink.MAVLink_param_set_message(
            target.system,
            target.component,
            b"SIM_SPEEDUP",
            times_real_time,
            mavlink.MAV_PARAM_TYPE_REAL32,
        )

    def is_simulation(self, version: Any, system_id: int, *, shows_it: bool) -> bool:
        """Return whether ArduCopter has sent what only SITL sends, and names no board."""
        del system_id
        return shows_it and not has_board_ids(version)

    def fence_parameters(
        self, *, has_areas: bool, ceiling_m: float | None, action: FenceAction
    ) -> dict[str, int | float]:
        """Return ArduPilot's FENCE_* of a fence (AC_Fence)."""
        kinds = (_AREAS_BIT if has_areas else 0) | (_ALTITUDE_BIT if ceiling_m else 0)
        parameters: dict[str, int | float] = {}
        if ceiling_m is not None:
            parameters["FENCE_ALT_MAX"] = ceiling_m
        return parameters | {
            # Avoidance keeps this distance from the fence, 2 m by default: too much in a hall.
            "FENCE_MARGIN": 0.0,
            "FENCE_TYPE": kinds,
            "FENCE_ACTION": _FENCE_ACTIONS[action],
            "FENCE_ENABLE": 1,
        }

    def _heading_mask(self, yaw_rad: float | None, yaw_rate_rad_s: float | None) -> int:
        # With both ignored it turns in its flight direction (WP_YAW_BEHAVIOR); rate 0 prevents it.
        del yaw_rate_rad_s
        return IGNORE_YAW if yaw_rad is None else IGNORE_YAW_RATE
