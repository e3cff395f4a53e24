"""Conversion factors of units into those used here: m, rad, m/s, m/s2, Pa.

Factors are exact by definition (SI brochure, 2019; international yard and pound agreement, 1959).
"""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

LengthUnit = Literal["m", "mm", "cm", "km", "ft", "in", "yd", "mi", "nmi"]
AngleUnit = Literal["rad", "deg", "grad", "turn"]
SpeedUnit = Literal["m_s", "km_h", "ft_s", "mph", "kn"]
AccelerationUnit = Literal["m_s2", "g", "ft_s2"]
PressureUnit = Literal["pa", "kpa", "mbar", "psi"]

METRES: Mapping[LengthUnit, float] = MappingProxyType(
    {
        "m": 1.0,
        "mm": 1e-3,
        "cm": 1e-2,
        "km": 1e3,
        "ft": 0.3048,
        "in": 0.0254,
        "yd": 0.9144,
        "mi": 1609.344,
        "nmi": 1852.0,
    }
)
RADIANS: Mapping[AngleUnit, float] = MappingProxyType(
    {"rad": 1.0, "deg": math.pi / 180, "grad": math.pi / 200, "turn": math.tau}
)
METRES_PER_SECOND: Mapping[SpeedUnit, float] = MappingProxyType(
    {"m_s": 1.0, "km_h": 1 / 3.6, "ft_s": 0.3048, "mph": 0.44704, "kn": 1852 / 3600}
)
METRES_PER_SECOND_SQUARED: Mapping[AccelerationUnit, float] = MappingProxyType(
    {"m_s2": 1.0, "g": 9.80665, "ft_s2": 0.3048}
)
PASCALS: Mapping[PressureUnit, float] = MappingProxyType(
    {"pa": 1.0, "kpa": 1e3, "mbar": 100.0, "psi": 6894.757293168361}
)
