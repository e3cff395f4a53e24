"""Items of a mission, a fence or a list of rally points, as an autopilot keeps them."""

from typing import NamedTuple


class Item(NamedTuple):
    """One item; x and y as they travel (1e-7 degrees or 1e-4 m), z in metres."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: int = 1
