"""docs/autonomy.md: its autonomy, pasted beside a campaign as the page says, flies the gate."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.orchestrator.conftest import SMALL_CAMERAS
from tests.test_house import ROOT

PAGE = (ROOT / "docs" / "autonomy.md").read_text("utf-8")


def test_the_autonomy_of_the_page_passes_the_gate(
    fly_run: Callable[..., Any], tmp_path: Path
) -> None:
    (code,) = re.findall(r"(?ms)^```python\n(.*?)^```$", PAGE)
    (used,) = re.findall(r"In the campaign: `autonomy: (\{use: my_autonomy\.py:.+\})`", PAGE)
    (tmp_path / "my_autonomy.py").write_text(code)
    given = used.replace("my_autonomy.py", str(tmp_path / "my_autonomy.py"))
    result, _ = fly_run("gate", "large", "sim", sets=(f"autonomy={given}",), cameras=SMALL_CAMERAS)
    assert (result.verdict, result.reason) == ("PASS", "")
