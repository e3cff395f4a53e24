"""Step functions over time, and their minimum and maximum in moving windows.

Times are whole nanoseconds, so that the bounds of windows meet the samples exactly.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]
Indices = NDArray[np.int64]

NEVER_NS = int(np.iinfo(np.int64).max)
NO_ORIGIN = -1
"""The origin of a value that comes from no sample."""


@dataclass(frozen=True, slots=True)
class StepFunction:
    """A step function over time: values[i] from times_ns[i] on, the last one without end.

    times_ns: ascending, relative to the begin of the evaluation. origins: a number for the sample
    that each value comes from; NO_ORIGIN where there is none.
    """

    times_ns: Indices
    values: Values
    origins: Indices

    def negated(self) -> "StepFunction":
        """Return the step function with the other sign."""
        return StepFunction(self.times_ns, -self.values, self.origins)

    def until_ns(self) -> Indices:
        """Return the end of each step's value."""
        return np.append(self.times_ns[1:], NEVER_NS)

    def compressed(self) -> "StepFunction":
        """Return the step function without times at which the value does not change."""
        kept = np.append(True, self.values[1:] != self.values[:-1])  # a flag
        return StepFunction(self.times_ns[kept], self.values[kept], self.origins[kept])


def aligned_steps(left: StepFunction, right: StepFunction) -> tuple[StepFunction, StepFunction]:
    """Return two step functions over the times of both; both begin at the same time."""
    if np.array_equal(left.times_ns, right.times_ns):
        return left, right
    times_ns = np.union1d(left.times_ns, right.times_ns)
    return _over(left, times_ns), _over(right, times_ns)


def _over(steps: StepFunction, times_ns: Indices) -> StepFunction:
    index = np.searchsorted(steps.times_ns, times_ns, side="right") - 1
    return StepFunction(times_ns, steps.values[index], steps.origins[index])


def steps_split_at(steps: StepFunction, time_ns: int) -> StepFunction:
    """Return the step function with a step at a time, if that is after its begin."""
    if time_ns <= steps.times_ns[0]:
        return steps
    return _over(steps, np.union1d(steps.times_ns, np.array([time_ns])))


def higher_steps(left: StepFunction, right: StepFunction) -> StepFunction:
    """Return the higher of two step functions at each time; the left where equal."""
    left, right = aligned_steps(left, right)
    return _choose_steps(right.values > left.values, left, right).compressed()


def lower_steps(left: StepFunction, right: StepFunction) -> StepFunction:
    """Return the lower of two step functions at each time; the left where equal."""
    left, right = aligned_steps(left, right)
    return _choose_steps(right.values < left.values, left, right).compressed()


def _choose_steps(
    second: NDArray[np.bool_], first: StepFunction, other: StepFunction
) -> StepFunction:
    return StepFunction(
        first.times_ns,
        np.where(second, other.values, first.values),
        np.where(second, other.origins, first.origins),
    )


def implied_steps(
    premise: StepFunction, conclusion: StepFunction, *, positive: bool
) -> StepFunction:
    """Return the step function of an implication: max of negated premise and conclusion.

    positive: whether it is to hold. Where both are violated, the origin is that of the conclusion
    then, which readers call violated.
    """
    denied, conclusion = aligned_steps(premise.negated(), conclusion)
    values = np.maximum(denied.values, conclusion.values)
    named = positive & (values < 0.0) & (conclusion.origins != NO_ORIGIN)
    concluded = (conclusion.values >= denied.values) | named
    origins = np.where(concluded, conclusion.origins, denied.origins)
    return StepFunction(denied.times_ns, values, origins).compressed()


def highest_within(
    steps: StepFunction, enters_ns: Indices, leaves_ns: Indices, from_ns: int, until_ns: int
) -> StepFunction:
    """Return a step function's moving maximum, for each time from from_ns to until_ns.

    enters_ns, leaves_ns: from when and until when each value lies in the window, both ascending.
    The first of equal values counts; an empty window is -inf. One pass over all values (Lemire,
    "Streaming maximum-minimum filter", 2006).
    """
    if from_ns == until_ns:
        within = np.flatnonzero((enters_ns <= from_ns) & (leaves_ns > from_ns))
        best = [int(within[np.argmax(steps.values[within])])] if within.size else [-1]
        return _of_indices(steps, np.array([from_ns]), best)
    both = np.concatenate((enters_ns, leaves_ns))
    moments_ns = np.unique(np.append(both[(both > from_ns) & (both <= until_ns)], from_ns))
    values, enters, leaves = steps.values.tolist(), enters_ns.tolist(), leaves_ns.tolist()
    found: list[int] = []
    window: deque[int] = deque()
    following = 0
    for moment in moments_ns.tolist():
        while following < len(values) and enters[following] <= moment:
            while window and values[window[-1]] < values[following]:
                window.pop()
            window.append(following)
            following += 1
        while window and leaves[window[0]] <= moment:
            window.popleft()
        found.append(window[0] if window else -1)
    return _of_indices(steps, moments_ns, found)


def _of_indices(steps: StepFunction, times_ns: Indices, found: list[int]) -> StepFunction:
    """Return the step function of selected indices; -inf for none."""
    index = np.array(found)
    values = np.where(index < 0, -np.inf, steps.values[index])
    origins = np.where(index < 0, NO_ORIGIN, steps.origins[index])
    return StepFunction(times_ns, values, origins).compressed()


def steps_held_until(held: StepFunction, reached: StepFunction, end_ns: int) -> StepFunction:
    """Return the robustness steps of `held` until, by end_ns at the latest, `reached`.

    At a time t: the highest over t' >= t of the lower of reached(t') and of the lowest of held
    from t to t', both ends included; after end_ns t' is t alone.
    """
    held, reached = aligned_steps(
        steps_split_at(held, end_ns + 1), steps_split_at(reached, end_ns + 1)
    )
    now = _choose_steps(reached.values < held.values, held, reached)
    values, origins = now.values.tolist(), now.origins.tolist()
    holds, holders = held.values.tolist(), held.origins.tolist()
    last = int(np.searchsorted(held.times_ns, end_ns, side="right")) - 1
    for i in range(last - 1, -1, -1):
        kept, origin = values[i + 1], origins[i + 1]
        if holds[i] < kept:
            kept, origin = holds[i], holders[i]
        if kept > values[i]:
            values[i], origins[i] = kept, origin
    return StepFunction(held.times_ns, np.array(values), np.array(origins)).compressed()
