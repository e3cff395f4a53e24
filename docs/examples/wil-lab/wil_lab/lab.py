from pydantic import Field

from wil_campaign.api import LimitOracle, RangefinderReading, Windowed, oracle


class CalmParameters(Windowed):
    max_m_s: float = Field(gt=0, description="fastest climb or sink rate")


class Calm(LimitOracle):
    motion = frozenset({"velocity"})

    def __init__(self, terms, max_m_s):
        super().__init__(terms, unit="m/s", limit=max_m_s)
        self.max_m_s = max_m_s

    def on_pose(self, sample):
        rate = abs(sample.velocity_ned_m_s[2])
        if not self.stages.covers(sample.t_s):
            return ()
        margin, text = self.max_m_s - rate, f"; the limit is {self.max_m_s:g} m/s"
        return self.judge_margin(
            sample.t_s, rate, margin, lambda: f"{self.vehicle} climbs at {rate:.2f} m/s{text}"
        )


@oracle("calm", "climbs and sinks no faster than max_m_s", CalmParameters)
def calm(terms, parameters, context):
    return Calm(terms, parameters.max_m_s)


def fault(address, kind):
    return "" if kind == "rangefinder" else f"an echo is no {kind}"


class Echo:
    unusable = 0

    def __init__(self, request):
        self.name, self.request, self.t_s = request.address, request, 0.0

    def open(self):
        self.range_m = float(self.name.removeprefix("echo://"))

    def next(self):
        self.t_s += 1 / self.request.rate_hz
        what = {"source": self.request.side, "range_m": self.range_m, "mount": self.request.mount}
        return RangefinderReading(self.t_s, self.t_s, seq=0, range_min_m=0.1, range_max_m=9, **what)

    def close(self):
        pass
