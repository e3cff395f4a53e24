"""Rules for which injected messages PX4 1.15 and later acts on, on multicopters.

Each rule names its source in PX4's tree; parameters as in its own documentation.
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

# CollisionPrevention.cpp: is_active is CP_DIST > 0; used by the tasks of manual Position mode.
_COLLISION_PREVENTION: tuple[InjectionRule, ...] = (
    ModesRule(
        frozenset({"POSCTL"}),
        "collision prevention acts on a pilot's sticks in Position mode only: OFFBOARD and "
        "missions do not avoid injected obstacles",
    ),
    ParameterRule("CP_DIST", "collision prevention is off", 2, above=0),
    # FlightTaskManualAcceleration.cpp calls it; the tasks of the other stick modes do not.
    ParameterRule(
        "MPC_POS_MODE",
        "this kind of stick control has no collision prevention (4 is acceleration)",
        4,
        one_of=(4,),
    ),
)
# ekf2_params: EKF2_EV_CTRL bit 0 horizontal, 1 vertical position, 2 velocity, 3 yaw.
_VISION: tuple[InjectionRule, ...] = (
    ParameterRule(
        "EKF2_EV_CTRL", "the estimator does not use external positions (bit 0)", 1, bits=1
    ),
)

PX4: Mapping[InjectionKind, tuple[InjectionRule, ...]] = MappingProxyType(
    {
        "obstacle_distance": _COLLISION_PREVENTION,
        "obstacle_distance_3d": (
            NeverRule("PX4 does not use OBSTACLE_DISTANCE_3D", "inject obstacle_distance"),
        ),
        "path_planning": (
            NeverRule(
                "PX4 plans no path around obstacles",
                "let the autonomy plan, from the mixed lidar",
            ),
        ),
        "distance_sensor": (
            ParameterRule(
                "EKF2_RNG_CTRL", "the estimator does not use a rangefinder", 1, one_of=(1, 2)
            ),
        ),
        "distance_sensor_sideways": _COLLISION_PREVENTION,
        # navigator_params.c: 0 disabled, 1 warn only, 2 return, 3 land, 4 hold.
        "adsb_vehicle": (
            ParameterRule("NAV_TRAFF_AVOID", "PX4 only warns of traffic", 4, one_of=(2, 3, 4)),
        ),
        "other_global_position": (
            NeverRule("PX4 does not use other vehicles' positions", "inject adsb_vehicle"),
        ),
        "collision": (
            NeverRule(
                "PX4 does not act on COLLISION",
                "inject adsb_vehicle; COLLISION is for ground stations",
            ),
        ),
        # mavlink_receiver.cpp: frame LOCAL_NED with position_valid; lost after PLD_BTOUT.
        "landing_target": (
            ModesRule(frozenset({"PRECLAND", "MISSION", "RTL"}), "no landing is guided"),
            ConditionalRule(
                ParameterRule("RTL_PLD_MD", "RTL lands without precision", 1, one_of=(1, 2)),
                frozenset({"RTL"}),
            ),
        ),
        "vision_position_estimate": _VISION,
        "odometry": _VISION,
        "gps_input": (NeverRule("PX4 does not use GPS_INPUT", "inject odometry instead"),),
        # geofence_params.c: GF_ACTION 0 none, 1 warning.
        "fence": (ParameterRule("GF_ACTION", "PX4 only warns of a breach", 2, above=1),),
        "flight_termination": (),
        "inject_failure": (
            ParameterRule("SYS_FAILURE_EN", "failures are not injected", 1, one_of=(1,)),
        ),
    }
)
