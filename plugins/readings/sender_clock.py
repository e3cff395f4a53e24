"""Whether the clock that stamps the messages of a recording was set between two of them; pure."""

_JUMP_S, _FASTEST = 10.0, 100.0
"""A stamp may be so much later than the log times tell: of a simulation, so many times faster."""


def clock_set_text(step_s: float, by_log_s: float) -> str:
    """Return how far a stamp is from the one before where its clock was set; "" where it was not.

    step_s: from the stamp before to this one; by_log_s: the same of the log times. After such a
    step the later messages would not be due for years.
    """
    if step_s <= _JUMP_S + _FASTEST * max(0.0, by_log_s):
        return ""
    return (
        f"is {step_s:.6g} s after the one before, and was logged {by_log_s:.3g} s after it: the "
        "sender's clock was set; cut the recording there"
    )
