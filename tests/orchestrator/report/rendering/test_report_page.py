"""The page: what it says first, and that nothing from a file is more than text."""

import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tests.orchestrator.report.recorded_campaign import HOSTILE, write_campaign
from wil_campaign.orchestrator.cli import verdict_table
from wil_campaign.orchestrator.reading.model import CampaignDocuments
from wil_campaign.orchestrator.report.campaign_report import write_report
from wil_campaign.orchestrator.report.model import RunReport
from wil_campaign.orchestrator.report.rendering.markup import svg_element, visible_text
from wil_campaign.orchestrator.report.rendering.page import page_anchors, render_page, render_run
from wil_campaign.orchestrator.report.rendering.scales import tick_step, value_scale


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = write_campaign(tmp_path_factory.mktemp("results") / "gate")
    written = write_report(folder)
    assert written.path == folder / "report.html"
    assert written.problems == ()
    return written.path.read_text("utf-8")


class _Reader(HTMLParser):
    """Collects elements, what could act or ask for something, and ids."""

    def __init__(self) -> None:
        super().__init__()
        self.names: list[str] = []
        self.acting: list[str] = []
        self.addresses: list[str] = []
        self.ids: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.append(tag)
        for name, value in attrs:
            if name.startswith("on") or name == "style":
                self.acting.append(f"{tag} {name}={value}")
            if name in {"src", "href", "poster", "data", "action"}:
                self.addresses.append(value or "")
            if name == "id":
                self.ids.append(value or "")


@pytest.fixture(scope="module")
def elements(page: str) -> _Reader:
    reader = _Reader()
    reader.feed(page)
    return reader


def test_the_verdict_comes_first_and_then_why(page: str) -> None:
    text = re.sub(r"<style>.*?</style>", "", page, flags=re.DOTALL)
    text = re.sub(r"<[^>]+>", " ", text)
    order = [
        "not accepted",
        "1 of the 2 required runs passed",
        "because large/wil is 0/1 (needs 1/1)",
        "No hardware flew: 'real' is the embedded surrogate".replace("'", "&#39;"),
        "Mode wil is world in the loop",
        "Runs that decide the verdict",
        "real touched gate.left",
    ]
    places = [text.index(words) for words in order]
    assert places == sorted(places)


def test_runs_that_are_only_reported_have_a_heading_of_their_own(tmp_path: Path) -> None:
    folder = write_campaign(tmp_path / "gate")
    for file in (folder / "large/wil/1/result.json", folder / "summary.json"):
        document = json.loads(file.read_text("utf-8"))
        for one in document.get("runs", [document]):
            one["required"] = one["mode"] != "wil"
        file.write_text(json.dumps(document), "utf-8")
    text = write_report(folder).path.read_text("utf-8")
    assert "Runs that decide the verdict" not in text
    assert "1 of the 1 required run passed." in text
    assert "Of the 1 runs that are only reported, 0 passed." in text
    assert text.index("Reported only: runs that did not pass") < text.index("large/wil/1")


def test_the_head_names_omitted_controls_and_explains_them(tmp_path: Path) -> None:
    folder = write_campaign(tmp_path / "gate")
    file = folder / "summary.json"
    document = json.loads(file.read_text("utf-8"))
    document["left_out"] = ["the controls of gate (fly_controls: false)"]
    file.write_text(json.dumps(document), "utf-8")
    text = write_report(folder).path.read_text("utf-8")
    head = text[text.index("<header") : text.index("</header>")]
    assert "Required but left out: the controls of gate (fly_controls: false)." in head
    assert "Controls are runs that must not pass" in head


def test_a_run_with_a_stand_in_says_so_where_real_flew(page: str) -> None:
    said = "No hardware flew"
    wil = page[page.index('id="run-large-wil-1"') :]
    sim = page[page.index('id="run-large-sim-1"') :].split("</article>", maxsplit=1)[0]
    assert said in wil.split("</header>")[0]
    assert "the vehicle cannot touch: <bdi>gate</bdi>" in wil.split("</header>")[0]
    assert said not in sim


def test_a_failed_run_names_its_cause_before_anything_else(page: str) -> None:
    run = page[page.index('id="run-large-wil-1"') :]
    order = ["real touched gate.left", "collision of real", "2.00 s after the goal", "commanded"]
    order += ["data:image/webp", "Around the moment", "from above", "Over time", "Oracles"]
    places = [run.index(words) for words in order]
    assert places == sorted(places)


@pytest.mark.parametrize(
    ("verdict", "heading"),
    [
        ("FAIL", "What was violated"),
        ("INVALID", "Why it is INVALID"),
        ("ERROR", "What went wrong"),
        ("ABORTED", "Who aborted it"),
    ],
)
def test_the_cause_of_every_verdict_has_its_heading(
    tmp_path: Path, verdict: str, heading: str
) -> None:
    folder = write_campaign(tmp_path / "gate")
    for file in folder.glob("large/wil/*/result.json"):
        document = json.loads(file.read_text("utf-8"))
        file.write_text(json.dumps({**document, "verdict": verdict}), "utf-8")
    summary = json.loads((folder / "summary.json").read_text("utf-8"))
    for run in summary["runs"]:
        if (run["case"], run["mode"]) == ("large", "wil"):
            run["verdict"] = verdict
    (folder / "summary.json").write_text(json.dumps(summary), "utf-8")
    written = write_report(folder)
    text = written.path.read_text("utf-8")
    assert heading in text
    assert "cannot be shown" not in text


def test_the_plots_say_from_what_their_seconds_count(tmp_path: Path, page: str) -> None:
    assert "Seconds since the goal was given." in page
    folder = write_campaign(tmp_path / "gate")
    for log in folder.glob("large/*/*/log.jsonl"):
        lines = log.read_text("utf-8").splitlines(keepends=True)
        log.write_text("".join(line for line in lines if '"goal"' not in line), "utf-8")
    text = write_report(folder).path.read_text("utf-8")
    assert "Seconds on the run clock: no goal is recorded." in text
    assert "Seconds since the goal" not in text


def test_nothing_from_a_file_acts(elements: _Reader) -> None:
    assert elements.names.count("script") == 1
    assert elements.names.count("style") == 1
    assert not elements.acting
    kinds = ("#", "data:image/webp;base64,", "data:,", "./large/")
    assert all(address.startswith(kinds) for address in elements.addresses), elements.addresses
    assert len(elements.ids) == len(set(elements.ids))


def test_an_image_that_is_shown_again_stands_in_the_page_once(page: str) -> None:
    articles = page.split("<article")[1:]
    assert len(articles) == 2
    for run in articles:
        now = run[run.index('<figure class="now">') :].split("</figure>")[0]
        assert "<img data-again" in now
        assert "data:image" not in now


def test_a_passing_run_begins_with_why_it_passed(page: str) -> None:
    run = page[page.index('id="run-large-sim-1"') :].split("</article>", maxsplit=1)[0]
    order = [
        "The required check held.",
        "collision, with 0.30 m to spare, at +2.00 s",
        "Why it passed",
    ]
    order += ["at least 0 m", "What the autonomy perceived"]
    places = [run.index(words) for words in order]
    assert places == sorted(places)


def test_a_control_that_failed_as_expected_is_not_red(tmp_path: Path) -> None:
    folder = write_campaign(tmp_path / "gate")
    file = folder / "large/wil/1/result.json"
    document = json.loads(file.read_text("utf-8"))
    control = {"case": "large", "verdict": "FAIL", "oracle": None, "cause": None, "met": True}
    file.write_text(json.dumps({**document, "required": False, "control": control}), "utf-8")
    text = write_report(folder).path.read_text("utf-8")
    run = text[text.index('id="run-large-wil-1"') :]
    assert '<span class="badge met">FAIL</span>' in run.split("</header>")[0]
    assert "What ended it, as required" in run
    overview = text[: text.index("<article")]
    assert '<span class="badge FAIL">' not in overview
    assert overview.count('<span class="badge met">FAIL</span>') == 2


def test_a_control_that_passed_is_not_green(tmp_path: Path) -> None:
    """As in the terminal's table: this campaign cannot fail."""
    folder = write_campaign(tmp_path / "gate")
    file = folder / "large/sim/1/result.json"
    document = json.loads(file.read_text("utf-8"))
    control = {"case": "large", "verdict": "FAIL", "oracle": None, "cause": None, "met": False}
    file.write_text(json.dumps({**document, "required": False, "control": control}), "utf-8")
    text = write_report(folder).path.read_text("utf-8")
    run = text[text.index('id="run-large-sim-1"') :]
    assert '<span class="badge unmet">PASS</span>' in run.split("</header>")[0]
    overview = text[: text.index("<article")]
    assert '<span class="badge PASS">' not in overview
    assert overview.count('<span class="badge unmet">PASS</span>') == 3


def test_a_run_whose_files_are_gone_is_named_at_the_top(tmp_path: Path) -> None:
    """The verdict was green, and what was missing stood on the page of the run alone."""
    folder = write_campaign(tmp_path / "gate")
    shutil.rmtree(folder / "large/sim/1")
    text = write_report(folder).path.read_text("utf-8")
    top = text[: text.index("Cases and modes")]
    assert "What cannot be shown" in top
    assert "large/sim/1: result.json is missing" in top


def test_many_damaged_runs_are_counted_at_the_top() -> None:
    run = RunReport(name="a/wil/1", case="a", mode="wil", rep="1", result=None, problems=("gone",))
    pages = [replace(render_run(run, anchor="x"), verdict="PASS", name=str(k)) for k in range(30)]
    documents = CampaignDocuments(name="gate", folder="x", entries=())
    text = render_page(documents, (), pages, made_utc="")
    top = text[: text.index("Cases and modes")]
    assert "<li>10: gone</li>" in top
    assert "<li>11: gone</li>" not in top
    assert "and 19 more: the pages of the runs have them" in top


def test_no_card_is_empty(page: str) -> None:
    for card in ("why", "what", "then", "saw"):
        found = re.findall(rf'<(section|div) class="{card}">\s*(.{{0,14}})', page)
        assert found
        assert not [one for one in found if one[1].startswith("</")]


def test_text_that_is_html_or_control_is_seen_as_text(page: str) -> None:
    assert HOSTILE not in page
    assert "&lt;img src=x onerror=" in page
    assert "\N{SYMBOL FOR ESCAPE}[31m&lt;U+202E&gt;" in page
    assert "\x1b" not in page
    assert "\u202e" not in page


def test_the_policy_lets_nothing_in_but_the_page_itself(page: str) -> None:
    found = re.search(r'Content-Security-Policy" content="([^"]+)"', page)
    assert found is not None
    policy = found[1]
    assert "default-src 'none'" in policy.replace("&#39;", "'")
    assert "unsafe" not in policy
    assert "http" not in policy
    # What comes before the policy is not under it.
    assert page.index("Content-Security-Policy") < page.index("<style>")


def test_text_in_svg_is_escaped_in_contents_and_attributes() -> None:
    made = svg_element("text", {"class": '"><script>', "x": 1.005}, ["</text><script>"])
    assert made == (
        '<text class="&#34;&gt;&lt;script&gt;" x="1">&lt;/text&gt;&lt;script&gt;</text>'
    )


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain", "plain"),
        ("Zürich 5 µs\n", "Zürich 5 µs\n"),
        ("a\x00b\x1b[0m", "a\u2400b\u241b[0m"),
        ("\u202eevil\u2066", "<U+202E>evil<U+2066>"),
        ("\ud800", "<U+D800>"),
    ],
)
def test_control_characters_are_seen(text: str, shown: str) -> None:
    assert visible_text(text) == shown


def test_every_run_has_an_anchor_of_its_own() -> None:
    found = page_anchors(["a/sim/1", "a sim 1", "ä/sim/1", "ö/sim/1"])
    assert len(set(found)) == 4
    assert all(re.fullmatch(r"[A-Za-z0-9_-]+", one) for one in found)


@pytest.mark.parametrize(
    "values", [[], [0.0], [1e-9, 2e-9], [-3.0, 17.0], [1e300, -1e300], [float("nan"), 1.0]]
)
def test_an_axis_holds_its_values_between_round_numbers(values: list[float]) -> None:
    scale = value_scale(values)
    assert scale.low < scale.high
    assert scale.ticks
    assert all(0.0 <= scale.share(value) <= 1.0 for value in values if value == value)  # noqa: PLR0124


@pytest.mark.parametrize(("span", "step"), [(10.0, 2.0), (1.0, 0.2), (24.0, 5.0), (0.0, 2e-7)])
def test_steps_are_round(span: float, step: float) -> None:
    assert tick_step(span, 5) == pytest.approx(step)


def test_the_table_of_cases_has_the_words_of_the_terminal(page: str) -> None:
    table = page.partition('id="cases"')[2].partition("</thead>")[0]
    words = re.findall(r"<th[^>]*>([^<]+)</th>", table)
    of_terminal = [name.replace("\n", " ") for name in verdict_table._COLUMNS]
    assert set(words) - set(of_terminal) == {"needs"}
    assert {"clearance m", "skew ms", "error px"} <= set(words)
