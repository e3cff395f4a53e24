"""What is published, and what waits to be."""

import asyncio
import itertools
import json
import math

from tests.orchestrator.operator.test_campaign_controller import RESULT
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.operator.run_messages import (
    RunEventReport,
    RunProgressReport,
    VehicleProgress,
)
from wil_campaign.plugins.mqtt.mqtt_reports import (
    Publication,
    publications_of_news,
    verdict_publication,
)
from wil_campaign.plugins.mqtt.outbox import PublicationOutbox


def test_a_run_s_standing_and_its_vehicles() -> None:
    vehicle = VehicleProgress("real", True, "OFFBOARD", "in_air", (1.23456, 0.0, -1.0), None, 0.9)
    news = RunProgressReport(
        "large", "wil", 2, "goal", 12.3456, clearance_m=math.inf, vehicles=(vehicle,)
    )
    run, real = publications_of_news(news)
    assert (run.topic, run.important, run.retain) == ("run", False, False)
    assert json.loads(run.payload)["clearance_m"] is None
    assert real.topic == "vehicle/real"
    assert json.loads(real.payload) == {
        "run": "large/wil/2",
        "armed": True,
        "mode": "OFFBOARD",
        "landed": "in_air",
        "position_ned_m": [1.235, 0.0, -1.0],
        "velocity_ned_m_s": None,
        "battery_fraction": 0.9,
    }


def test_events_are_important_publications() -> None:
    def of(kind: str, word: str) -> Publication:
        news = RunEventReport("large/wil/1", 9.0, kind, word, "real", "said")  # type: ignore[arg-type]
        (publication,) = publications_of_news(news)
        assert publication.important
        return publication

    assert of("stage", "goal").topic == "run"
    assert of("collision", "collision").topic == "collision"
    assert of("guard", "fence").topic == "guard"
    first = of("decisive", "FAIL")
    assert (first.topic, json.loads(first.payload)["final"]) == ("verdict", False)
    last = verdict_publication(RESULT)
    assert (last.topic, json.loads(last.payload)["final"]) == ("verdict", True)


def publication(topic: str, number: int, *, important: bool = False) -> Publication:
    return Publication(topic, b"%d" % number, important)


def test_important_publications_go_first_and_none_is_dropped() -> None:
    async def main() -> list[tuple[str, bytes]]:
        outbox = PublicationOutbox()
        outbox.put(publication("run", 1))
        outbox.put(publication("verdict", 2, important=True))
        outbox.put(publication("verdict", 3, important=True))
        assert not outbox.empty
        first = await outbox.take()
        outbox.put_back(first)
        taken = [await outbox.take() for _ in range(3)]
        return [(one.topic, one.payload) for one in taken]

    assert run_virtual(main()) == [("verdict", b"2"), ("verdict", b"3"), ("run", b"1")]


def test_the_newest_state_is_given_five_times_a_second() -> None:
    async def main() -> list[tuple[float, bytes]]:
        loop, outbox = asyncio.get_running_loop(), PublicationOutbox()
        taken: list[tuple[float, bytes]] = []

        async def take() -> None:
            while True:
                one = await outbox.take()
                taken.append((round(loop.time(), 3), one.payload))

        task = asyncio.create_task(take())
        for number in range(100):
            outbox.put(publication("run", number))
            await asyncio.sleep(0.01)
        await asyncio.sleep(1.0)
        task.cancel()
        return taken

    taken = run_virtual(main())
    assert 5 <= len(taken) <= 7
    assert taken[-1][1] == b"99"
    assert all(later[0] - one[0] >= 0.19 for one, later in itertools.pairwise(taken))


def test_an_outbox_that_is_full_says_so() -> None:
    async def main() -> None:
        outbox = PublicationOutbox()
        for number in range(10_005):
            outbox.put(publication("verdict", number, important=True))
        assert outbox.dropped == 5

    run_virtual(main())
