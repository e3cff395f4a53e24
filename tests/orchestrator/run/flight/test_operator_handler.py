"""A run acknowledges each command of an operator that reaches it, at once."""

import asyncio

from orchestrator.model.progress import Happening, News
from safety.guard.core.operator_command import OperatorCommand
from tests.orchestrator.conftest import Fly


class Script:
    """Gives commands when the goal has been given, and takes what the run reports."""

    def __init__(self, *commands: OperatorCommand) -> None:
        self._commands = list(commands)
        self._has_goal = False
        self.given_s: list[float] = []
        self.acknowledged: list[Happening] = []

    def poll(self) -> OperatorCommand | None:
        if not self._has_goal or not self._commands:
            return None
        self.given_s.append(asyncio.get_running_loop().time())
        return self._commands.pop(0)

    def hear(self, news: News) -> None:
        if isinstance(news, Happening) and (news.kind, news.word) == ("stage", "goal"):
            self._has_goal = True
        if isinstance(news, Happening) and news.kind == "acknowledged":
            self.acknowledged.append(news)


def test_each_command_is_acknowledged_with_its_id_when_it_arrives(fly_run: Fly) -> None:
    script = Script(
        OperatorCommand("hold", "anna", command_id="1"),
        OperatorCommand("abort", "ben", command_id="2"),
    )
    result, _ = fly_run(mode="sim", inbox=script, report=script.hear)
    assert result.verdict == "INVALID"  # held after its goal was given
    seen = [(one.word, one.who, one.command_id) for one in script.acknowledged]
    assert seen == [("hold", "anna", "1"), ("abort", "ben", "2")]
    assert [one.t_s for one in script.acknowledged] == script.given_s
    assert {one.run for one in script.acknowledged} == {"large/sim/1"}
