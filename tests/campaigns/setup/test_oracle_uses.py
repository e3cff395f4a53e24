"""Names of oracles: those of the other parts that decide verdicts are refused."""

import re
from pathlib import Path

import pytest

from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.safety.model.verdict import PARTS

ROOT = Path(__file__).parents[3]
SOURCE = re.compile(r"""source ?= ?f?"([a-z-]+)[./]""")


@pytest.mark.parametrize("name", [*PARTS, "guard.lost"])
def test_an_oracle_with_the_name_of_another_part_is_refused(name: str) -> None:
    sets = (f"oracles={{{name}: {{use: altitude, max_m: 2}}, landed: {{}}}}",)
    with pytest.raises(BadInput, match=f"'{name}' is the name of a part of a run"):
        load_campaign(ROOT / "campaigns" / "gate.yaml", ExpansionOptions(sets=sets))


def test_the_parts_are_those_that_decide_runs() -> None:
    files = [file for at in ("orchestrator", "plugins") for file in (ROOT / at).rglob("*.py")]
    found = {word for file in files for word in SOURCE.findall(file.read_text("utf-8"))}
    assert found | {"evidence"} == set(PARTS)
