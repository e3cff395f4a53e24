"""PX4's custom_mode, made apart from the product's reading of it."""


def px4_custom_mode(main: int, sub: int = 0) -> int:
    """Return HEARTBEAT.custom_mode of a main and sub mode (px4_custom_mode.h)."""
    return main << 16 | sub << 24
