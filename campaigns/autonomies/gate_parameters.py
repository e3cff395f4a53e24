"""Parameters of the gate autonomy, as a campaign sets them under `with`."""

from collections.abc import Mapping
from dataclasses import dataclass

from wil_campaign.api import NAMED_COLORS

from .parameters import read_autonomy_parameters

OWNER = "gate autonomy"


@dataclass(frozen=True, slots=True)
class GateParameters:
    """The parameters of the gate autonomy: the keys of `with`.

    speed_m_s, acceleration_m_s2: ahead. side_speed_m_s: highest speed sideways, up and down; kp,
    ki, kd: of their controllers. past_m: how far behind the gate to stop. color: of the gate.
    lost_s: time without a sight of the gate after which it stops; search_timeout_s: then it reports
    that it gave up, and hovers. cone: allowed distance from the centre line at full speed, per
    metre to the gate (and its width). commit_widths: the same when it enters, in widths of the
    gate. camera_stabilized: a gimbal keeps the camera level.
    """

    speed_m_s: float = 0.8
    acceleration_m_s2: float = 0.8
    side_speed_m_s: float = 0.5
    kp: float = 1.2
    ki: float = 0.06
    kd: float = 0.15
    past_m: float = 0.6
    color: str = "orange"
    lost_s: float = 0.5
    search_timeout_s: float = 15.0
    cone: float = 0.12
    commit_widths: float = 0.15
    camera_stabilized: bool = False


def parse_gate_parameters(given: Mapping[str, object]) -> GateParameters:
    """Return the gate autonomy's parameters. Raises ValueError listing unknown or wrong ones."""
    return read_autonomy_parameters(
        GateParameters,
        given,
        OWNER,
        may_be_zero=frozenset({"ki", "kd"}),
        choices={"color": tuple(NAMED_COLORS)},
    )
