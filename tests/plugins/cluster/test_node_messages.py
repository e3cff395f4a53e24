"""Messages between the machines of a cluster: whole after a round trip, refused when damaged."""

from pathlib import Path

import msgspec
import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.foundation.processes.codec import ProcessMessageError
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.orchestrator.operator.run_messages import RunEventReport, RunProgressReport
from wil_campaign.orchestrator.run_results.run_result import EarlierAttempt
from wil_campaign.orchestrator.state.return_path import ReturnPath
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.plugins.cluster.node_messages import (
    CampaignBrought,
    CommandSent,
    DamagedMessageError,
    NodeFacts,
    RunEnded,
    RunOrdered,
    decode_facts,
    decode_to_campaign,
    decode_to_node,
    encode_to_campaign,
    encode_to_node,
    news_message,
)
from wil_campaign.plugins.cluster.travelling_files import TravellingFile, TravellingFiles
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.worlds.frames import Pose


def order_of(folder: Path) -> RunOrder:
    sets = ("goal.altitude_m=1.25",)
    plan = load_campaign(write_hover(folder), ExpansionOptions(repetitions=1, sets=sets)).runs[0]
    return RunOrder(
        plan=plan,
        folder=folder / "out\udce9",
        clock="virtual",
        attempts=(EarlierAttempt("ERROR", "worker lost", "a/1"),),
        back=ReturnPath(
            stand=Pose.of(1.0, 2.0, 0.0), start=Pose((0.0, 0.0, 0.0)), altitude_m=2.0, speed_m_s=1
        ),
        liftoff_delays_s={"real": 0.5},
    )


def test_an_order_is_the_same_on_the_node_and_has_each_text_once(tmp_path: Path) -> None:
    order = order_of(tmp_path)
    content = encode_to_node(RunOrdered(order, "hover/1"))
    assert decode_to_node(content) == RunOrdered(order, "hover/1")
    document = order.plan.files.campaign
    text = document.root.place.source.lines[0].encode()
    assert content.count(text) == 1
    received = decode_to_node(content)
    assert isinstance(received, RunOrdered)
    again = received.order.plan.files.campaign
    assert again.problem(("goal",), "wrong") == document.problem(("goal",), "wrong")


def test_an_order_whose_texts_are_missing_is_refused(tmp_path: Path) -> None:
    content = encode_to_node(RunOrdered(order_of(tmp_path), "a"))
    *rest, sources = msgspec.msgpack.decode(content)
    assert sources
    with pytest.raises(DamagedMessageError, match="an order names a text that it does not have"):
        decode_to_node(msgspec.msgpack.encode([*rest, []]))


def test_a_value_that_no_message_can_have_is_refused_in_words(tmp_path: Path) -> None:
    sets = (f"autonomy={{use: still.py:Still, with: {{ticks: {10**30}}}}}",)
    plan = load_campaign(write_hover(tmp_path), ExpansionOptions(repetitions=1, sets=sets)).runs[0]
    with pytest.raises(
        ProcessMessageError, match="a value of the campaign cannot be sent to a node"
    ):
        encode_to_node(RunOrdered(RunOrder(plan=plan, folder=tmp_path, clock="virtual"), "a"))


def test_names_of_files_need_not_be_utf_8() -> None:
    folder = Path("/home/\udce9")
    files = TravellingFiles((TravellingFile(folder / "a.py", "aa", b"\xff\x00"),), (folder,))
    message = CampaignBrought(folder, "s", files, "file:///nfs", "a")
    assert decode_to_node(encode_to_node(message)) == message


def test_messages_to_the_campaign_are_the_same_there() -> None:
    progress = RunProgressReport("a", "sim", 1, "goal", 2.0, skew_ms=3.5)
    happening = RunEventReport("a/sim/1", 1.0, "guard", "hold", "real", "text")
    for message in (
        news_message(progress),
        news_message(happening),
        RunEnded.of(WorkerLost("lost", "trace", "ValueError"), kept="node:/tmp/x"),
        NodeFacts({"node": "here"}),
    ):
        assert decode_to_campaign(encode_to_campaign(message)) == message
    command = CommandSent(OperatorCommand("abort", "ben", bench="hall-a"))
    assert decode_to_node(encode_to_node(command)) == command


def test_half_of_a_surrogate_pair_in_a_reason_does_not_lose_the_run() -> None:
    ended = RunEnded.of(WorkerLost("ValueError: \ud800 \u00e9"))
    received = decode_to_campaign(encode_to_campaign(ended))
    assert received == RunEnded.of(WorkerLost("ValueError: \\ud800 \u00e9"))


def test_facts_are_the_first_message_and_name_the_node() -> None:
    assert decode_facts(encode_to_campaign(NodeFacts({"node": "a"}))) == {"node": "a"}
    for wrong in (NodeFacts({}), RunEnded()):
        with pytest.raises(DamagedMessageError, match="are not the facts of a node"):
            decode_facts(encode_to_campaign(wrong))


def test_an_end_without_a_result_is_a_lost_run() -> None:
    assert isinstance(RunEnded().outcome, WorkerLost)
