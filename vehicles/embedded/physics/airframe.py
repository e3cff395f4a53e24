"""The quadrotor that JSBSim flies: its masses and dimensions, and its JSBSim aircraft file.

JSBSim frames: structural x aft, y right, z up; body x forward, y right, z down.
"""

import hashlib
import math
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

_POUNDS_PER_NEWTON = 0.22480894387096
_FOOT_POUNDS_PER_NEWTON_METRE = 0.737562149
_SQUARE_FEET_PER_SQUARE_METRE = 10.7639
_METRES_PER_FOOT = 0.3048
MOTORS = 4
LEGS = ((1, 1), (-1, -1), (1, -1), (-1, 1))
"""The legs: forward and right, in leg offsets."""


@dataclass(frozen=True, slots=True)
class Airframe:
    """The airframe of a quadrotor in X: masses in kg, lengths in m, thrust in N, times in s.

    The defaults are 0.5 kg and 0.3 m wide, the size of the paper's Parrot Anafi (0.24 x 0.32 m
    unfolded). Inertia, arm length and the ratio of rotor torque to thrust are those published for
    a quadrotor of the same mass: AscTec Hummingbird, Michael, Mellinger, Lindsey and Kumar, "The
    GRASP Multiple Micro-UAV Testbed" (2010).
    """

    mass_kg: float = 0.5
    inertia_xx_kg_m2: float = 2.32e-3
    inertia_yy_kg_m2: float = 2.32e-3
    inertia_zz_kg_m2: float = 4.0e-3
    arm_m: float = 0.175
    """Hub to motor."""
    torque_per_thrust_m: float = 0.0245
    motor_lag_s: float = 0.05
    max_thrust_n: float = 2.7
    """Of each motor: a thrust-to-weight ratio of 2.2, usual for camera drones."""
    drag_area_m2: tuple[float, float, float] = (0.010, 0.010, 0.020)
    """Drag coefficient times area along body x, y, z."""
    min_drag_speed_m_s: float = 2.0
    """Drag grows linearly up to this speed (rotor drag), with its square above."""
    linear_drag_n_s_m: float = 0.0
    """Additional drag per speed, in every direction and at every speed."""
    angular_damping_n_m_s: float = 0.0006
    leg_offset_m: float = 0.10
    leg_height_m: float = 0.06
    leg_stiffness_n_m: float = 500.0
    """Four legs carry the vehicle with 2.5 mm of deflection."""
    leg_damping_n_s_m: float = 12.0
    body_width_m: float = 0.30
    body_height_m: float = 0.10

    @property
    def motor_offset_m(self) -> float:
        """Return the distance of each motor from the hub along x, and along y."""
        return self.arm_m / math.sqrt(2.0)

    @property
    def hover_thrust_n(self) -> float:
        """Return the thrust of one motor that carries a quarter of the weight."""
        return self.mass_kg * 9.80665 / MOTORS

    @property
    def standing_m(self) -> float:
        """Return the height of the hub over the ground on which it stands."""
        return self.leg_height_m - self.hover_thrust_n / self.leg_stiffness_n_m

    def motors(self) -> tuple[tuple[float, float, int], ...]:
        """Return the airframe's motors: forward, right, sign of torque, PX4's quad X order.

        Front right and rear left turn counterclockwise: their reaction turns the body clockwise.
        """
        a = self.motor_offset_m
        return ((a, a, 1), (-a, -a, 1), (a, -a, -1), (-a, a, -1))


def aircraft_xml(airframe: Airframe, *, motor_lag_s: float) -> str:
    """Return the airframe's JSBSim aircraft; motor thrust lags its command (first order)."""
    a = airframe
    return f"""<?xml version="1.0"?>
<fdm_config name="quadx" version="2.0" release="BETA">
 <fileheader><description>Quadrotor in X</description></fileheader>
 <metrics>
  <wingarea unit="M2">0.1</wingarea><wingspan unit="M">0.3</wingspan><chord unit="M">0.3</chord>
  <htailarea unit="M2">0</htailarea><htailarm unit="M">0</htailarm>
  <vtailarea unit="M2">0</vtailarea><vtailarm unit="M">0</vtailarm>
  {_location("AERORP")}{_location("EYEPOINT")}{_location("VRP")}
 </metrics>
 <mass_balance>
  <ixx unit="KG*M2">{a.inertia_xx_kg_m2}</ixx><iyy unit="KG*M2">{a.inertia_yy_kg_m2}</iyy>
  <izz unit="KG*M2">{a.inertia_zz_kg_m2}</izz>
  <emptywt unit="KG">{a.mass_kg}</emptywt>{_location("CG")}
 </mass_balance>
 <ground_reactions>{_legs(a)}</ground_reactions>
 <external_reactions>{_thrusts(a)}{_torque(a)}</external_reactions>
 <propulsion/>
 <flight_control name="esc">
  {"".join(f'<property value="0">fcs/motor{i}-cmd-n</property>' for i in range(MOTORS))}
  <channel name="esc">{_lags(a, motor_lag_s)}</channel>
 </flight_control>
 <aerodynamics>{_drags(a)}{_dampings(a)}</aerodynamics>
</fdm_config>
"""


def aircraft_root(airframe: Airframe, *, motor_lag_s: float) -> Path:
    """Return a JSBSim root folder that holds the airframe as aircraft `quadx`.

    One folder per content, in this user's temporary folder; written by a rename, so that several
    processes may do so at once.
    """
    text = aircraft_xml(airframe, motor_lag_s=motor_lag_s)
    digest = hashlib.sha256(text.encode()).hexdigest()[:16]
    root = Path(tempfile.gettempdir()) / f"wil-jsbsim-{os.getuid()}" / digest
    target = root / "aircraft" / "quadx" / "quadx.xml"
    if not target.is_file() or target.read_text(encoding="utf-8") != text:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(
            "w", dir=target.parent, suffix=".part", delete=False, encoding="utf-8"
        ) as part:
            part.write(text)
        Path(part.name).replace(target)
    return root


def _location(name: str) -> str:
    """Return a location in the airframe's JSBSim XML."""
    return f'<location name="{name}" unit="M"><x>0</x><y>0</y><z>0</z></location>'


def _legs(a: Airframe) -> str:
    """Return the legs in the airframe's JSBSim XML."""
    return "".join(
        f"""
  <contact type="BOGEY" name="LEG{i}">
   <location unit="M"><x>{-forward * a.leg_offset_m}</x><y>{right * a.leg_offset_m}</y>
    <z>{-a.leg_height_m}</z></location>
   <static_friction>0.9</static_friction><dynamic_friction>0.7</dynamic_friction>
   <rolling_friction>0.7</rolling_friction>
   <spring_coeff unit="N/M">{a.leg_stiffness_n_m}</spring_coeff>
   <damping_coeff unit="N/M/SEC">{a.leg_damping_n_s_m}</damping_coeff>
   <damping_coeff_rebound unit="N/M/SEC">{a.leg_damping_n_s_m}</damping_coeff_rebound>
   <max_steer unit="DEG">0</max_steer><brake_group>NONE</brake_group><retractable>0</retractable>
  </contact>"""
        for i, (forward, right) in enumerate(LEGS)
    )


def _thrusts(a: Airframe) -> str:
    """Return the motor thrusts in the airframe's JSBSim XML."""
    return "".join(
        f"""
  <force name="m{i}" frame="BODY">
   <function><product><property>fcs/motor{i}-n</property><value>{_POUNDS_PER_NEWTON}</value>
   </product></function>
   <location unit="M"><x>{-forward}</x><y>{right}</y><z>0.02</z></location>
   <direction><x>0</x><y>0</y><z>-1</z></direction>
  </force>"""
        for i, (forward, right, _) in enumerate(a.motors())
    )


def _torque(a: Airframe) -> str:
    """Return the motor torques in the airframe's JSBSim XML."""
    gain = a.torque_per_thrust_m * _FOOT_POUNDS_PER_NEWTON_METRE
    terms = "".join(
        f"<product><property>fcs/motor{i}-n</property><value>{sign * gain}</value></product>"
        for i, (_, _, sign) in enumerate(a.motors())
    )
    return (
        f'<moment name="yawq" frame="BODY"><function><sum>{terms}</sum></function>'
        "<direction><x>0</x><y>0</y><z>1</z></direction></moment>"
    )


def _lags(a: Airframe, lag_s: float) -> str:
    """Return the motor lags in the airframe's JSBSim XML."""
    return "".join(
        f"""
   <actuator name="fcs/motor{i}"><input>fcs/motor{i}-cmd-n</input><lag>{1.0 / lag_s}</lag>
    <clipto><min>0</min><max>{a.max_thrust_n}</max></clipto><output>fcs/motor{i}-n</output>
   </actuator>"""
        for i in range(MOTORS)
    )


def _drags(a: Airframe) -> str:
    """Return the drag in the airframe's JSBSim XML."""
    axes = zip(("X", "Y", "Z"), ("u", "v", "w"), a.drag_area_m2, strict=True)
    slow_fps = a.min_drag_speed_m_s / 0.3048
    return "".join(
        f"""
  <axis name="{axis}"><function name="aero/{axis}drag"><product>
   <value>{-0.5 * area * _SQUARE_FEET_PER_SQUARE_METRE}</value>
   <property>atmosphere/rho-slugs_ft3</property><property>velocities/{speed}-aero-fps</property>
   <max><property>velocities/vt-fps</property><value>{slow_fps}</value></max>
  </product></function>{_linear_drag(a, axis, speed)}</axis>"""
        for axis, speed, area in axes
    )


def _linear_drag(a: Airframe, axis: str, speed: str) -> str:
    """Return the drag per speed in the airframe's JSBSim XML; empty when there is none."""
    if a.linear_drag_n_s_m == 0.0:
        return ""
    pounds_per_fps = a.linear_drag_n_s_m * _POUNDS_PER_NEWTON * _METRES_PER_FOOT
    return f"""
  <function name="aero/{axis}rotor"><product><value>{-pounds_per_fps}</value>
   <property>velocities/{speed}-aero-fps</property></product></function>"""


def _dampings(a: Airframe) -> str:
    """Return the rotational damping in the airframe's JSBSim XML."""
    gain = -a.angular_damping_n_m_s * _FOOT_POUNDS_PER_NEWTON_METRE
    return "".join(
        f"""
  <axis name="{axis}"><function name="aero/{axis}damp"><product><value>{gain}</value>
   <property>velocities/{rate}-aero-rad_sec</property></product></function></axis>"""
        for axis, rate in (("ROLL", "p"), ("PITCH", "q"), ("YAW", "r"))
    )
