"""Rules for which injected messages ArduCopter 4.5 and later acts on.

Each rule names its source in ArduPilot's tree; parameters as in its own documentation.
"""

from collections.abc import Mapping
from types import MappingProxyType

from wil_campaign.plugins.injection.rules import (
    ConditionalRule,
    InjectionKind,
    InjectionRule,
    ModesRule,
    NeverRule,
    ParameterRule,
)
from wil_campaign.vehicles.setpoints import Setpoints

_GUIDED = frozenset({"GUIDED"})
_NAVIGATES = frozenset({"AUTO", "GUIDED", "RTL"})

# AP_Proximity_MAV.cpp: data older than 500 ms is dropped; any frame is treated as the body's.
_PROXIMITY = ParameterRule(
    "PRX1_TYPE",
    "obstacles over MAVLink are ignored",
    2,
    one_of=(2,),
    more_names=("PRX_TYPE",),
    reboot=True,
)
# AC_Avoid.cpp, var_info: ENABLE, bit 1 UseProximitySensor.
_AVOID = ParameterRule("AVOID_ENABLE", "the proximity sensor does not stop it (bit 1)", 2, bits=2)
_AVOID_MODES = ModesRule(
    frozenset({"GUIDED", "ALT_HOLD", "LOITER"}), "simple avoidance is not used"
)
# AP_OAPathPlanner.cpp, var_info: TYPE 1 BendyRuler, 2 Dijkstra, 3 both.
_PLANNER = ParameterRule(
    "OA_TYPE", "no path is planned around obstacles", 1, one_of=(1, 2, 3), reboot=True
)
_PATHLESS: tuple[Setpoints, ...] = ("velocity", "attitude")
# Parameters.cpp: GUID_OPTIONS bit 6, "Waypoint navigation used for position targets".
_GUIDED_BY_WAYPOINTS = ParameterRule(
    "GUID_OPTIONS", "position targets are flown straight, not by waypoint navigation", 64, bits=64
)
# mode_guided.cpp: velocities are adjusted by AC_Avoid, positions are not.
_GUIDED_POSITIONS = ConditionalRule(
    NeverRule(
        "position setpoints in GUIDED are not adjusted by simple avoidance",
        "send velocity setpoints, or inject for path_planning (OA_TYPE, GUID_OPTIONS)",
    ),
    _GUIDED,
    "position",
)
# mode_guided.cpp, angle_control_run: attitudes are flown without adjustment.
_GUIDED_ATTITUDES = ConditionalRule(
    NeverRule("attitude setpoints are not adjusted by simple avoidance", "send velocity setpoints"),
    _GUIDED,
    "attitude",
)
_SIMPLE_AVOIDANCE: tuple[InjectionRule, ...] = (
    _PROXIMITY,
    _AVOID,
    _AVOID_MODES,
    _GUIDED_POSITIONS,
    _GUIDED_ATTITUDES,
)

# AP_Avoidance.cpp, var_info: ENABLE; F_ACTION 0 none, 1 report, 2 and above moves.
_TRAFFIC: tuple[InjectionRule, ...] = (
    ParameterRule("AVD_ENABLE", "other aircraft are not avoided", 1, one_of=(1,)),
    ParameterRule("AVD_F_ACTION", "an imminent collision is reported at most", 3, above=1),
)
# AP_VisualOdom.cpp: TYPE 1 MAVLink, 2 T265, 3 VOXL; AP_NavEKF_Source: POSXY 6 ExternalNav.
_VISION: tuple[InjectionRule, ...] = (
    ParameterRule("VISO_TYPE", "external poses are ignored", 1, one_of=(1, 2, 3), reboot=True),
    ParameterRule("EK3_SRC1_POSXY", "the estimator uses another position source", 6, one_of=(6,)),
)

ARDUPILOT: Mapping[InjectionKind, tuple[InjectionRule, ...]] = MappingProxyType(
    {
        "obstacle_distance": _SIMPLE_AVOIDANCE,
        "obstacle_distance_3d": _SIMPLE_AVOIDANCE,
        "path_planning": (
            _PROXIMITY,
            _PLANNER,
            ModesRule(_NAVIGATES, "there is no path to plan"),
            *(
                ConditionalRule(
                    NeverRule(f"{kind} setpoints have no path to plan", "send position setpoints"),
                    _GUIDED,
                    kind,
                )
                for kind in _PATHLESS
            ),
            ConditionalRule(_GUIDED_BY_WAYPOINTS, _GUIDED, "position"),
        ),
        # AP_RangeFinder_MAVLink.cpp: the orientation must be the configured one.
        "distance_sensor": (
            ParameterRule(
                "RNGFND1_TYPE",
                "a rangefinder over MAVLink is ignored",
                10,
                one_of=(10,),
                reboot=True,
            ),
            ParameterRule(
                "RNGFND1_ORIENT", "only this direction is used (25 is down)", 25, one_of=(25,)
            ),
        ),
        "distance_sensor_sideways": _SIMPLE_AVOIDANCE,
        # AP_ADSB.cpp, var_info: TYPE; any receiver lets in ADSB_VEHICLE over MAVLink.
        "adsb_vehicle": (
            ParameterRule("ADSB_TYPE", "transponder messages are ignored", 1, above=0, reboot=True),
            *_TRAFFIC,
        ),
        "other_global_position": _TRAFFIC,
        "collision": (
            NeverRule(
                "ArduPilot sends COLLISION but ignores it",
                "inject adsb_vehicle or obstacle_distance; COLLISION is for ground stations",
            ),
        ),
        # AC_PrecLand_MAVLink.cpp: TYPE 1, frame BODY_FRD or angles; 1 s without is lost.
        "landing_target": (
            ParameterRule("PLND_ENABLED", "precision landing is off", 1, one_of=(1,)),
            ParameterRule("PLND_TYPE", "targets over MAVLink are ignored", 1, one_of=(1,)),
            ModesRule(frozenset({"LAND", "RTL", "AUTO"}), "no landing is guided"),
        ),
        "vision_position_estimate": _VISION,
        "odometry": _VISION,
        "gps_input": (
            ParameterRule(
                "GPS1_TYPE",
                "fixes over MAVLink are ignored",
                14,
                one_of=(14,),
                more_names=("GPS_TYPE",),
                reboot=True,
            ),
        ),
        # AC_Fence.cpp, var_info: ENABLE, TYPE bit 2 circles and polygons, ACTION 0 report only.
        "fence": (
            ParameterRule("FENCE_ENABLE", "its own fence is off", 1, one_of=(1,)),
            ParameterRule(
                "FENCE_TYPE", "uploaded circles and polygons are ignored (bit 2)", 4, bits=4
            ),
            ParameterRule("FENCE_ACTION", "a breach is reported at most", 1, above=0),
        ),
        "flight_termination": (),
        "inject_failure": (
            NeverRule(
                "ArduPilot does not support INJECT_FAILURE",
                "in SITL set the SIM_ parameter of the failure",
            ),
        ),
    }
)
