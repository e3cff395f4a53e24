"""Computes the figures of a flight of step responses; pure."""

import math

from wil_campaign.plugins.step_response.segments import SPEEDS_M_S, Series, StepSample

Figures = dict[str, dict[str, float | None]]
"""By segment and name, which ends with the unit. None: the measured event did not happen."""

_STEADY_FROM_S = 4.0
_CLIMB_STEADY_FROM_S = 2.0


def figures_of(flown: Series, speeds_m_s: tuple[float, ...] = SPEEDS_M_S) -> Figures:
    """Return the figures of a flight that was flown to its end."""
    yaw_rad = flown[f"speed {speeds_m_s[0]}"][0].yaw_rad
    north, east = math.cos(yaw_rad), math.sin(yaw_rad)
    figures: Figures = {}
    for v in speeds_m_s:
        samples = flown[f"speed {v}"]
        speed = [(q.t_s - samples[0].t_s, q.vn_m_s * north + q.ve_m_s * east) for q in samples]
        late = [x for t, x in speed if t > _STEADY_FROM_S]
        steady = sum(late) / len(late)
        figures[f"speed {v}"] = {
            "steady_m_s": round(steady, 3),
            "peak_m_s": round(max(x for _, x in speed), 3),
            "t63_s": _first_s(speed, 0.63 * steady),
            "t90_s": _first_s(speed, 0.9 * steady),
        }
        way = _way(flown[f"stop {v}"], north, east)
        figures[f"stop {v}"] = {"distance_m": round(max(x for _, x in way), 3)}
    samples = flown["position 2"]
    way = _way(samples, north, east)
    figures["position 2"] = {
        "t90_s": _first_s(way, 1.8),
        "overshoot_m": round(max(x for _, x in way) - way[-1][1], 3),
        "peak_m_s": round(max(q.vn_m_s * north + q.ve_m_s * east for q in samples), 3),
    }
    samples = flown["climb 0.5"]
    rise = [(q.t_s - samples[0].t_s, -q.vd_m_s) for q in samples]
    late = [x for t, x in rise if t > _CLIMB_STEADY_FROM_S]
    figures["climb 0.5"] = {
        "steady_m_s": round(sum(late) / len(late), 3),
        "t63_s": _first_s(rise, 0.315),
    }
    samples = flown["yaw 60"]
    turn = [
        (q.t_s - samples[0].t_s, math.degrees(math.remainder(q.yaw_rad - yaw_rad, math.tau)))
        for q in samples
    ]
    figures["yaw 60"] = {
        "t90_s": _first_s(turn, 54.0),
        "overshoot_deg": round(max(x for _, x in turn) - 60, 1),
    }
    return figures


def _way(samples: list[StepSample], north: float, east: float) -> list[tuple[float, float]]:
    """Return (s, m) along the heading from the segment's first sample."""
    t, x, y = samples[0][:3]
    return [(q.t_s - t, (q.north_m - x) * north + (q.east_m - y) * east) for q in samples]


def _first_s(points: list[tuple[float, float]], level: float) -> float | None:
    """Return when a level is reached first; None when it is not."""
    return next((round(t, 2) for t, x in points if x >= level), None)
