"""summary.json is that of `to_json` to the byte, and encodes a run once."""

from dataclasses import replace

import pytest

from tests.orchestrator.run_results.test_results import result, summary
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.run_results import campaign_results
from wil_campaign.orchestrator.run_results.campaign_results import Summary, SummaryText
from wil_campaign.orchestrator.run_results.run_result import RunResult

SPLIT = result("FAIL", 2, reason='"runs": []\n  "controls": [],\n  "runs": []')


@pytest.mark.parametrize("runs", [[], [result()], [result(), SPLIT]])
@pytest.mark.parametrize("controls", [[], [SPLIT], [result("INVALID", 3), result("FAIL", 4)]])
def test_the_text_is_that_of_the_whole(runs: list[RunResult], controls: list[RunResult]) -> None:
    whole = replace(summary(runs), controls=tuple(controls), caveats=(SPLIT.reason,))
    assert SummaryText().text(whole) == to_json(whole)


def test_a_run_is_encoded_again_only_when_it_has_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    encoded: list[int] = []

    def noted(document: object) -> str:
        encoded.extend([document.rep] if isinstance(document, RunResult) else [])
        return to_json(document)

    monkeypatch.setattr(campaign_results, "to_json", noted)
    writer, runs = SummaryText(), [result(rep=1), result(rep=2)]

    def text_of(*some: RunResult) -> tuple[str, Summary]:
        made = summary([*some])
        return writer.text(made), made

    for flown in (runs[:1], runs, [replace(runs[0]), replace(runs[1], verdict="FAIL")]):
        text, made = text_of(*flown)
        assert text == to_json(made)
    assert encoded == [1, 2, 2]
