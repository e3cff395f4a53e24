"""PX4 1.14 and later, multicopters.

Modes: px4_custom_mode.h (main mode in bits 16 to 23, sub mode in bits 24 to 31). Parameters:
commander_params.c and rtl_params.c.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.autopilot import (
    IGNORE_YAW,
    IGNORE_YAW_RATE,
    Autopilot,
    FenceAction,
    FlightMode,
    MavlinkTarget,
    command_long,
)
from wil_campaign.vehicles.autopilots.failsafes import (
    SILENT_S,
    AutopilotFailsafes,
    FailsafeRule,
    ReturnAltitudeParameter,
    ReturnsBy,
)
from wil_campaign.vehicles.autopilots.ground_truth import GroundTruth, read_hil_state
from wil_campaign.vehicles.autopilots.map_projections import Px4Projection
from wil_campaign.vehicles.autopilots.readiness import ReadinessRules

_AUTO = 4
_SETTABLE: dict[FlightMode, tuple[int, int]] = {
    FlightMode.HOLD: (_AUTO, 3),
    FlightMode.GUIDED: (6, 0),
    FlightMode.LAND: (_AUTO, 6),
    FlightMode.RTL: (_AUTO, 5),
    FlightMode.MISSION: (_AUTO, 4),
}
_MAIN: dict[int, tuple[str, FlightMode]] = {
    1: ("MANUAL", FlightMode.PILOT),
    2: ("ALTCTL", FlightMode.PILOT),
    3: ("POSCTL", FlightMode.PILOT),
    5: ("ACRO", FlightMode.PILOT),
    6: ("OFFBOARD", FlightMode.GUIDED),
    7: ("STABILIZED", FlightMode.PILOT),
    8: ("RATTITUDE", FlightMode.PILOT),
    9: ("SIMPLE", FlightMode.PILOT),
    10: ("TERMINATION", FlightMode.OTHER),
    11: ("ALTITUDE_CRUISE", FlightMode.PILOT),
}
_AUTO_SUB: dict[int, tuple[str, FlightMode]] = {
    1: ("READY", FlightMode.OTHER),
    2: ("TAKEOFF", FlightMode.TAKEOFF),
    3: ("HOLD", FlightMode.HOLD),
    4: ("MISSION", FlightMode.MISSION),
    5: ("RTL", FlightMode.RTL),
    6: ("LAND", FlightMode.LAND),
    8: ("FOLLOW_TARGET", FlightMode.OTHER),
    9: ("PRECLAND", FlightMode.LAND),
    10: ("VTOL_TAKEOFF", FlightMode.TAKEOFF),
}


def _describe_mode(custom_mode: int) -> tuple[str, FlightMode]:
    """Return PX4's name of a custom mode, and our mode."""
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    if main == _AUTO:
        return _AUTO_SUB.get(sub, (f"AUTO {sub}", FlightMode.OTHER))
    if main == 3 and sub == 1:
        return ("ORBIT", FlightMode.OTHER)
    return _MAIN.get(main, (f"mode {main}/{sub}", FlightMode.OTHER))


_LAND = 3
"""Of NAV_DLL_ACT."""
_EXCEPT_HOLD = 1 << 1
"""A bit of PX4's COM_DLL_EXCEPT: a lost ground station changes nothing in Hold."""
_WAYS_OF_RETURN: Mapping[int, frozenset[ReturnsBy]] = {
    0: frozenset({"rally"}),
    1: frozenset({"rally", "landing"}),
    2: frozenset({"mission"}),
    3: frozenset({"rally", "landing"}),
    4: frozenset({"mission"}),
}
_ANY_WAY: frozenset[ReturnsBy] = frozenset({"rally", "landing", "mission"})
"""A type that is not known here may do any of it."""


def _ways_of_return(values: Mapping[str, float]) -> frozenset[ReturnsBy]:
    """Return the places besides home to which PX4's RTL may fly."""
    return _WAYS_OF_RETURN.get(int(values.get("RTL_TYPE", 0)), _ANY_WAY)


_FAILSAFES = AutopilotFailsafes(
    on_silence={"NAV_DLL_ACT": float(_LAND), "COM_DL_LOSS_T": SILENT_S},
    rules=(
        FailsafeRule(
            names=("NAV_DLL_ACT",),
            wanted=_LAND,
            sound=frozenset({2, 3}),
            wrong="on link loss it would not land, or it would fall",
        ),
        FailsafeRule(
            names=("COM_DLL_EXCEPT",),
            forbidden=_EXCEPT_HOLD,
            wrong="it would ignore a link loss in Hold, in which the guard holds; take "
            f"{_EXCEPT_HOLD} (Hold) off it",
            is_optional=True,
        ),
        FailsafeRule(
            names=("RTL_LAND_DELAY",),
            least=0.0,
            wrong="on link loss it would return, and hover there until its battery is empty",
            is_optional=True,
            where=("NAV_DLL_ACT", frozenset({2})),
        ),
        FailsafeRule(
            names=("COM_DL_LOSS_T",),
            longest_s=30.0,
            wrong="it would take too long to detect a link loss",
        ),
        FailsafeRule(
            names=("COM_OBL_RC_ACT",),
            wanted=4,
            sound=frozenset({0, 1, 2, 3, 4, 5}),
            wrong="it would fall when setpoints stop",
        ),
        FailsafeRule(
            names=("COM_OF_LOSS_T",),
            longest_s=5.0,
            wrong="it would fly on for too long when setpoints stop",
        ),
    ),
    return_altitudes=(ReturnAltitudeParameter("RTL_RETURN_ALT", 1.0),),
    returning={"NAV_DLL_ACT": frozenset({2}), "COM_OBL_RC_ACT": frozenset({3})},
    ways=_ways_of_return,
    return_type="RTL_TYPE",
)
_FENCE_ACTIONS: dict[FenceAction, int] = {"report": 1, "hold": 2, "rtl": 3, "land": 5}
_SITL_UID = 0x4954414C44494E4F


class Px4(Autopilot):
    """PX4: setpoints must stream before and during OFFBOARD; takes off to a height above sea."""

    name: ClassVar[str] = "px4"
    label: ClassVar[str] = "PX4"
    mav_autopilot: ClassVar[int] = mavlink.MAV_AUTOPILOT_PX4
    # PX4 requires more than 2 Hz, and COM_OF_LOSS_T is 1 s.
    setpoint_rate_hz: ClassVar[float] = 20.0
    # "for at least a second": docs.px4.io, Offboard Mode.
    streams_before_guided_s: ClassVar[float] = 1.0
    # A takeoff armed in AUTO.TAKEOFF leaves the ground at once: a barrier needs to wait armed.
    arming_mode: ClassVar[FlightMode] = FlightMode.HOLD
    takeoff_modes: ClassVar[tuple[FlightMode, ...]] = (FlightMode.TAKEOFF, FlightMode.HOLD)
    spool_s: ClassVar[float] = 1.0
    """COM_SPOOLUP_TIME's default."""
    # MPC_TKO_RAMP_T is 3 s. Measured by our liftoff detector in flights of the gate in SIH.
    liftoff_s: ClassVar[float] = 3.2
    embedded_liftoff_s: ClassVar[float] = 2.9
    embedded_parameters: ClassVar[Path] = Path(__file__).with_name("px4_parameters.yaml")
    embedded_link: ClassVar[str] = "udpout://127.0.0.1:14540"
    takeoff_needs_amsl: ClassVar[bool] = True
    parameters_bytewise: ClassVar[bool] = True
    changes_mode_on_disarm: ClassVar[bool] = True
    refusal_prefixes: ClassVar[tuple[str, ...]] = (
        "Preflight Fail:",
        "Arming denied:",
        "Arming denied!",
        "Takeoff denied!",
    )
    # Its flags have CONST_POS_MODE set on the ground (1023): that bit is ignored.
    readiness_rules: ClassVar[ReadinessRules] = ReadinessRules(
        estimator_message="ESTIMATOR_STATUS",
        forbidden_flags=0,
        needs_home=True,
        glitch=(mavlink.ESTIMATOR_GPS_GLITCH, "GPS_GLITCH"),
    )
    estimator_message_id: ClassVar[int] = mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS
    accuracy_message_id: ClassVar[int | None] = mavlink.MAVLINK_MSG_ID_ODOMETRY
    truth_message_id: ClassVar[int] = mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION
    magnetometer_message_id: ClassVar[int] = mavlink.MAVLINK_MSG_ID_HIGHRES_IMU
    guided_name: ClassVar[str] = "OFFBOARD"
    motion_parameters: ClassVar[tuple[str, ...]] = ("MPC_",)
    # COM_OBL_RC_ACT 0 to 2 (FallbackPosCtrl, AltCtrl and Stab of failsafe/framework.cpp).
    fallback_modes: ClassVar[frozenset[str]] = frozenset({"POSCTL", "ALTCTL", "STABILIZED"})
    frame_parameters: ClassVar[tuple[str, ...]] = ("SYS_AUTOSTART",)
    # CRC-32 of all used parameters without volatile ones (param_hash_check in parameters.cpp).
    parameters_digest: ClassVar[str | None] = "_HASH_CHECK"
    failsafes: ClassVar[AutopilotFailsafes] = _FAILSAFES
    oldest_version: ClassVar[tuple[int, int]] = (1, 14)
    log_suffix: ClassVar[str] = ".ulg"
    most_fence_items: ClassVar[int] = 64  # DM_KEY_FENCE_POINTS_MAX (dataman.h)

    def mode_of(self, custom_mode: int) -> FlightMode:
        """Return our mode for a PX4 HEARTBEAT."""
        return _describe_mode(custom_mode)[1]

    def mode_name(self, custom_mode: int) -> str:
        """Return PX4's name of the mode."""
        return _describe_mode(custom_mode)[0]

    def set_mode(self, target: MavlinkTarget, mode: FlightMode) -> Any:
        """Return PX4's DO_SET_MODE (main mode, sub mode); raises ValueError for other modes."""
        if mode not in _SETTABLE:
            raise ValueError(f"{mode} is not a mode to set on PX4")
        main, sub = _SETTABLE[mode]
        custom = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
        return command_long(target, mavlink.MAV_CMD_DO_SET_MODE, custom, float(main), float(sub))

    def ground_truth(self, message: Any) -> GroundTruth:
        """Return the ground truth in a HIL_STATE_QUATERNION. Raises GroundTruthError."""
        return read_hil_state(message)

    def projection(self, latitude_deg: float, longitude_deg: float) -> Px4Projection:
        """Return PX4's map projection around a place."""
        return Px4Projection(latitude_deg, longitude_deg)

    def takeoff(
        self, target: MavlinkTarget, *, altitude_m: float, ground_amsl_m: float | None
    ) -> Any:
        """Return PX4's NAV_TAKEOFF at the present position and heading."""
        amsl_m = self._needed_amsl(ground_amsl_m) + altitude_m
        unused = (math.nan,) * 6
        return command_long(target, mavlink.MAV_CMD_NAV_TAKEOFF, *unused, amsl_m)

    def least_takeoff_parameter(self, version: tuple[int, int, int]) -> str | None:
        """Return PX4's minimum takeoff height, which since 1.15 is a default alone.

        Takeoff::set_takeoff_position of navigator/takeoff.cpp: "Using minimum takeoff altitude". A
        build without a version, (0, 0, 0), counts as new.
        """
        return "MIS_TAKEOFF_ALT" if (0, 0, 0) < version < (1, 15, 0) else None

    def is_simulation(self, version: Any, system_id: int, *, shows_it: bool) -> bool:
        """Return whether an AUTOPILOT_VERSION has the uid of PX4's SITL."""
        del shows_it
        # PX4 adds the system id minus one (mavlink_main.cpp).
        return bool(version.uid in {_SITL_UID, _SITL_UID + system_id - 1})

    def fence_parameters(
        self, *, has_areas: bool, ceiling_m: float | None, action: FenceAction
    ) -> dict[str, int | float]:
        """Return PX4's GF_* of a fence (geofence_params.c)."""
        del has_areas
        # GF_MAX_*_DIST are distances from home; 0 is off.
        return {
            "GF_MAX_HOR_DIST": 0.0,
            "GF_MAX_VER_DIST": ceiling_m or 0.0,
            "GF_ACTION": _FENCE_ACTIONS[action],
        }

    def _heading_mask(self, yaw_rad: float | None, yaw_rate_rad_s: float | None) -> int:
        # With neither it keeps its heading: PositionControl uses the present yaw.
        mask = IGNORE_YAW if yaw_rad is None else 0
        return mask | (IGNORE_YAW_RATE if yaw_rate_rad_s is None else 0)
