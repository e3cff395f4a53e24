"""Whatever is put in the place of a value, a campaign loads or is bad input: nothing else."""

import re
import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from tests.campaigns.conftest import CAMPAIGN, RECIPE, WORLD, Files
from wil_campaign.campaigns.expansion.expansion import load_campaign
from wil_campaign.foundation.files.documents import BadInput

_TOKEN = re.compile(r"[^\s{}\[\],:]+")
TEXTS = {"campaign.yaml": CAMPAIGN, "world.yaml": WORLD, "recipe.yaml": RECIPE}
SPOTS = [(name, match.span()) for name, text in TEXTS.items() for match in _TOKEN.finditer(text)]
REPLACEMENTS = st.sampled_from(
    [
        "",
        "~",
        "0",
        "-1",
        "1e300",
        "-1e-300",
        ".nan",
        "true",
        "[]",
        "{}",
        "[[]]",
        "{a: {b: 1}}",
        "[1, 2]",
        "'5'",
        "gate",
        "cage",
        "..",
        "/",
        "9223372036854775808",
        "'\\0'",
        '"\\0"',
        "*x",
        "a.b.c",
    ]
) | st.text(alphabet="ab01.-_/: {}[]", max_size=6)


@settings(max_examples=120, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(SPOTS), REPLACEMENTS), min_size=1, max_size=3))
def test_a_spoilt_campaign_is_bad_input_or_good(
    changes: list[tuple[tuple[str, tuple[int, int]], str]],
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        files = Files(Path(folder))
        texts = dict(TEXTS)
        for (name, (start, end)), new in sorted(changes, key=lambda change: -change[0][1][0]):
            texts[name] = texts[name][:start] + new + texts[name][end:]
        for name, text in texts.items():
            (files.folder / name).write_text(text)
        try:
            assert load_campaign(files.path).runs
        except BadInput as error:
            found = error
        else:
            return
    assert found.problems
    assert all(problem.message for problem in found.problems)
