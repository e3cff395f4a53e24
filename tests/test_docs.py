"""What the pages of docs/ show is true: recipes load, steps are all there, named tests exist."""

import importlib
import os
import re
import shlex
import tomllib
from pathlib import Path

import pytest

import wil_campaign.api
from docs import generate
from tests.recipes.samples import camera, plain
from wil_campaign.foundation.files import limits
from wil_campaign.foundation.files.documents import BadInput, parse_document
from wil_campaign.orchestrator.cli import all_commands, build_app
from wil_campaign.orchestrator.recording.trajectory import COLUMNS
from wil_campaign.plugins.paper_xml.paper_xml import parse_paper_xml
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.model.recipe import Recipe
from wil_campaign.recipes.model.registry import STAGES, registered_steps
from wil_campaign.recipes.pipeline.pipeline import compile_recipe

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
RECIPES = (DOCS / "recipes.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| `(\{?(\w+).*?)` \| .+ \|$", re.MULTILINE)
MORE_STEPS = """

class Brightest:
    def __call__(self, work, other):
        return work


def newest(sides):
    return sides["real"].reading
"""
"""What the page names and does not show."""
FITTING = {
    "units": "gps",
    "replace": "gps",
    "resample": "imu",
    "offset": "pose",
    "match_photometry": "camera",
    "overlay": "camera",
}
MERGES = {"lidar_points": "concatenate", "microphone": "add"}
GIVES = {"geodetic": "gps", "local": "pose", "to_points": "lidar_points"}


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", RECIPES, re.MULTILINE | re.DOTALL)


def loaded(text: str) -> Recipe:
    return load_recipe(parse_document(text.encode(), name="docs/recipes.md"))


@pytest.mark.parametrize("text", blocks("yaml"), ids=range(len(blocks("yaml"))))
def test_the_recipes_of_the_page_are_recipes(text: str) -> None:
    assert loaded(text).combinations


def test_the_xml_of_the_page_is_a_recipe() -> None:
    (text,) = blocks("xml")
    recipe = load_recipe(parse_paper_xml(text.encode(), name="docs/recipes.xml"))
    steps_of = [step.kind.name for step in recipe.combinations[0].steps]
    assert steps_of == ["resize", "isolate_color"]


def tables() -> dict[str, list[tuple[str, str]]]:
    """Return the rows of each stage's table: step, example."""
    found: dict[str, list[tuple[str, str]]] = {}
    for stage in STAGES:
        _, _, section = RECIPES.partition(f"### {stage.capitalize()}\n")
        rows = ROW.findall(section.partition("\n\n")[0])
        found[stage] = [(name, example) for example, name in rows]
    return found


def sensors_of(name: str, stage: str) -> tuple[str, ...]:
    (kind,) = (kind for kind in registered_steps() if (kind.name, kind.stage) == (name, stage))
    return tuple(kind.sensors)


def test_every_step_stands_on_the_page() -> None:
    listed = [(name, stage) for stage, rows in tables().items() for name, _ in rows]
    assert sorted(listed) == sorted((kind.name, kind.stage) for kind in registered_steps())


@pytest.mark.parametrize(
    ("stage", "name", "example"),
    [(stage, name, example) for stage, rows in tables().items() for name, example in rows],
)
def test_every_example_of_a_step_is_understood(
    tmp_path: Path, stage: str, name: str, example: str
) -> None:
    (tmp_path / "my_steps.py").write_text(blocks("python")[0] + MORE_STEPS)
    sensors = sensors_of(name, stage)
    works_on_all = len(sensors) == len(
        {sensor for kind in registered_steps() for sensor in kind.sensors}
    )
    given = FITTING.get(name, "camera" if works_on_all else sensors[-1])
    made = GIVES.get(name, given)
    beside = f"{stage}: [{example}], merge: {MERGES.get(made, 'overlay')}"
    step = f"merge: {example}" if stage == "merge" else beside
    text = (
        f"schema: wil/recipe/1\nsensors: {{s: {{type: {made}, twin_type: {given}}}}}\n"
        f"combine:\n  - {{sensor: s, {step}}}"
    )
    document = parse_document(text.encode(), name="example", path=tmp_path / "r.yaml")
    if name == "isolate_detections":
        with pytest.raises(BadInput, match=r"there is no file 'yolo\.onnx'"):
            load_recipe(document)
    else:
        assert load_recipe(document).combinations


def test_the_own_step_on_the_page_works(tmp_path: Path) -> None:
    (tmp_path / "my_steps.py").write_text(blocks("python")[0])
    text = (
        "schema: wil/recipe/1\nsensors: {s: {type: camera}}\ncombine:\n"
        "  - {sensor: s, filter: [{use: 'my_steps.py:desaturate', with: {amount: 1.0}}],"
        " merge: overlay}"
    )
    recipe = load_recipe(parse_document(text.encode(), name="r.yaml", path=tmp_path / "r.yaml"))
    (mixer,) = compile_recipe(recipe, object_ids={})
    mixed = mixer.mix(camera(source="real"), camera(plain((0, 90, 180))), now_s=1.0).reading
    assert mixed is not None
    assert (mixed.image_bgr == 90).all()


DECISIONS = DOCS / "decisions"
CAPABILITIES = (DECISIONS / "0065-what-the-paper-describes.md").read_text(encoding="utf-8")
SAFETY = (DECISIONS / "0066-barriers-and-their-tests.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", CAPABILITIES + SAFETY)))


def test_every_capability_names_a_test() -> None:
    rows = [line for line in CAPABILITIES.splitlines() if line.startswith("|")]
    told = [row for row in rows if not row.startswith(("| the paper", "|---"))]
    assert len(told) > 35
    for row in told:
        assert re.search(r"`tests/[\w/]+\.py::test_\w+` \|$", row), row


def test_every_barrier_names_a_test() -> None:
    table = SAFETY.partition("| hazard ")[2].partition("\n\n")[0]
    told = [row for row in table.splitlines()[2:] if row]
    assert len(told) > 20
    for row in told:
        assert re.search(r"\| `tests/[\w/]+\.py::test_\w+`[^|]*\|[^|]*\|$", row), row


def test_every_difference_of_the_embedded_vehicles_names_its_tests() -> None:
    decision = (DECISIONS / "0023-control-laws-of-the-firmwares.md").read_text(encoding="utf-8")
    _, _, section = decision.partition("## Where it differs from the firmwares\n")
    rows = [line for line in section.splitlines() if line.startswith("|")]
    told = [row for row in rows if not row.startswith(("|---", "| feature", "| where the two"))]
    assert len(told) > 30
    files = (
        (ROOT / "tests").glob("vehicles/**/test_*.py"),
        (ROOT / "tests/plugins").rglob("test_*.py"),
    )
    sources = "".join(path.read_text() for each in files for path in each)
    there = set(re.findall(r"^(?:async )?def (test_\w+)\(", sources, re.MULTILINE))
    for row in told:
        named = re.findall(r"`(test_\w+)`", row.rpartition("| ")[2])
        assert named, row
        assert set(named) <= there, row


@pytest.mark.parametrize(("file", "name"), NAMED, ids=[name for _, name in NAMED])
def test_the_test_that_proves_it_is_there(file: str, name: str) -> None:
    written = (ROOT / file).read_text(encoding="utf-8")
    assert re.search(rf"^\s*(async )?def {name}\(", written, re.MULTILINE)


ARCHITECTURE = (DOCS / "architecture.md").read_text(encoding="utf-8")
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
BY_NAME = frozenset(
    {
        "campaigns/autonomies/gate.py",
        "vehicles/autopilots/px4.py",
        "vehicles/links/udp.py",
        "recipes/steps/filter/isolation.py",
        "recipes/steps/merge/overlays.py",
    }
)
"""Files of a way that no other one of it imports: a registry or a folder finds them by name."""
WAY = re.compile(r"^## (The way of .+?)\n(.+?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)


def test_the_page_is_read_in_one_sitting() -> None:
    assert len(ARCHITECTURE.splitlines()) <= 250


@pytest.mark.parametrize(
    "path",
    sorted(
        set(re.findall(r"`((?:[a-z]\w*/)+(?:\w+\.\w+)?)`", ARCHITECTURE + CONTRIBUTING))
        - {"docs/", "docs/api.md", "docs/lists.md"}
    ),
)
def test_a_file_that_a_page_names_is_there(path: str) -> None:
    assert (ROOT / path).exists(), path


@pytest.mark.parametrize(
    ("title", "text"), [match.groups() for match in WAY.finditer(ARCHITECTURE)]
)
def test_a_way_has_as_many_files_as_it_says_and_each_meets_another(title: str, text: str) -> None:
    """A file of the way imports another one of it, or is imported by one: nothing is made up."""
    said = re.search(r"<!-- way: (\d+) files", text)
    files = re.findall(r"^\d+\. `([\w/.]+)`", text, re.MULTILINE)
    assert said is not None, title
    assert len(set(files)) == len(files) == int(said[1]), title
    imports = {file: imported_modules(ROOT / file) for file in files}
    for file in files:
        name = module_of(file)
        others = {other for other in files if other != file}
        met = any(name in imports[other] for other in others) or any(
            module_of(other) in imports[file] for other in others
        )
        assert met or file in BY_NAME, file


def module_of(file: str) -> str:
    return f"wil_campaign.{file.removesuffix('.py').replace('/', '.')}"


def imported_modules(path: Path) -> set[str]:
    return set(re.findall(r"^from ([\w.]+) import", path.read_text("utf-8"), re.MULTILINE))


def test_the_page_of_what_users_import_is_built_with_all_that_they_import() -> None:
    page = generate.api()
    for _, _, names in generate.sections():
        for name in names:
            assert re.search(rf"^### `(class )?{name}\b", page, re.MULTILINE), name
    for link in re.findall(r"\]\(([\w./]+)\)", page):
        assert Path(os.path.normpath(generate.API.parent / link)).is_file(), link


def test_the_page_names_all_that_users_import_and_each_can_be() -> None:
    shown: dict[str, set[str]] = {}
    for _, module, names in generate.sections():
        shown.setdefault(module, set()).update(names)
    assert shown["wil_campaign.api"] == set(wil_campaign.api.__all__)
    for module, exported in shown.items():
        there = importlib.import_module(module)
        assert all(hasattr(there, name) for name in exported), module


EXAMPLES = [
    *(ROOT / "campaigns" / "autonomies").glob("*.py"),
    *[page for page in DOCS.glob("*.md") if page.name != "architecture.md"],
]
PUBLIC = re.compile(r"wil_campaign(\.api|\.hooks)?")
"""What pages and shipped autonomies import; these also what stands beside them."""
OURS = re.compile(
    r"\s*(?:from|import) "
    r"((?:wil_campaign|orchestrator|vehicles|recipes|campaigns|safety|worlds|plugins)\b[\w.]*)"
)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_examples_for_users_import_public_modules_alone(path: Path) -> None:
    for line in path.read_text("utf-8").splitlines():
        found = OURS.match(line)
        assert found is None or PUBLIC.fullmatch(found[1]), line


def test_the_page_of_commands_has_every_command_and_no_other() -> None:
    table = (DOCS / "commands.md").read_text("utf-8").partition("## Commands\n")[2]
    table = table.partition("\n\n")[0]
    cells = [line.split(" | ")[0] for line in table.splitlines()[2:]]
    named = {word for cell in cells for word in re.findall(r"`(?:wil-campaign )?([a-z]+)", cell)}
    assert named == {name for name in all_commands() if " " not in name}


def command_lines(page: Path) -> list[str]:
    """Return the command lines of the program in the code blocks of a page, without its name."""
    text = page.read_text("utf-8").replace("\\\n", "")
    blocks = re.findall(r"(?ms)^ *```(?:sh|console)?\n(.*?)^ *```$", text)
    found = re.findall(r"(?m)^ *(?:\$ )?wil-campaign (.+?)(?= && |$)", "".join(blocks))
    return [line for line in found if "<" not in line]


def table_commands() -> list[str]:
    """Return the commands in the table of docs/commands.md, one of each choice."""
    table = (DOCS / "commands.md").read_text("utf-8").partition("## Commands\n")[2]
    cells = [line.split(" | ")[0] for line in table.partition("\n\n")[0].splitlines()[2:]]
    found = [code for cell in cells for code in re.findall(r"`(?:wil-campaign )?(.+?)`", cell)]
    return [code.partition("\\|")[0].replace("COMMAND", "abort") for code in found]


def test_every_command_line_of_the_pages_is_one_of_the_program() -> None:
    lines = [*table_commands(), *(line for page in PAGES for line in command_lines(page))]
    assert len(lines) > 80
    app = build_app()
    for line in lines:
        words = shlex.split(line, comments=True)
        function, *_ = app.parse_args(words, exit_on_error=False, print_error=False)
        assert callable(function), line


def test_the_page_of_lists_has_every_limit() -> None:
    page = generate.limits()
    named = {name: value for name, value in vars(limits).items() if name.startswith("MAX_")}
    assert len(named) > 5
    for name, value in named.items():
        assert f"| `{name}` | {value:,} |" in page


def test_the_page_of_files_has_every_column_and_every_extra() -> None:
    page = (DOCS / "files.md").read_text("utf-8")
    assert [name for name in COLUMNS if f"`{name}`" not in page] == []
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    for extra in {*project["optional-dependencies"]} - {"dev", "test"}:
        assert f"| `{extra}` |" in page


def test_the_glossary_is_sorted_and_the_index_has_every_page() -> None:
    first_table = (DOCS / "glossary.md").read_text("utf-8").partition("\n\n")[0]
    words = [row.split("|")[1].strip().casefold() for row in first_table.splitlines()[3:]]
    assert len(words) > 30
    assert words == sorted(words)
    index = (DOCS / "index.md").read_text("utf-8")
    pages = {path.name for path in DOCS.glob("*.md")} - {"index.md", "api.md", "lists.md"}
    assert {name for name in pages if f"({name})" not in index} == set()


@pytest.mark.parametrize("page", sorted(DOCS.glob("*.md")), ids=lambda page: page.name)
def test_a_list_or_table_begins_after_a_blank_line(page: Path) -> None:
    """MkDocs takes it for a part of the paragraph or code block before it otherwise."""
    text = re.sub(r"(?ms)^```.*?^```$", "```", page.read_text("utf-8"))
    blocks = re.split(r"\n(?:#.*)?\n|\n(?=#)", text)
    begins = re.compile(r"- |\d+\. |\|")
    for block in blocks:
        first, *rest = block.strip("\n").splitlines() or [""]
        if not first.startswith((" ", "#")) and not begins.match(first):
            assert [line for line in rest if begins.match(line)] == [], block


@pytest.mark.parametrize("page", sorted(DOCS.glob("*.md")), ids=lambda page: page.name)
def test_a_table_has_a_header_and_its_columns_in_each_row(page: Path) -> None:
    """A blank line within a table would end it: the rows after it are text then."""
    text = re.sub(r"(?ms)^ *```.*?^ *```$", "", page.read_text("utf-8"))
    for table in re.findall(r"(?m)^\|.*\n(?:\|.*\n?)*", text):
        first, second, *rows = re.sub(r"`[^`\n]*`", "", table).splitlines()
        assert set(second) <= set("|-"), table
        cells = [row.count("|") for row in (first, second, *rows)]
        assert len(set(cells)) == 1, table


PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS.rglob("*.md")]
COMMITTED = [path for path in PAGES if path not in {generate.API, generate.LISTS}]
LINK = re.compile(r"\]\((?!https?:|mailto:)([^)#\s]*)(?:#([^)\s]+))?\)")


def without_code(page: Path) -> str:
    return re.sub(r"(?ms)^ *```.*?^ *```$|`[^`\n]+`", "", page.read_text("utf-8"))


def anchors(page: Path) -> set[str]:
    text = re.sub(r"(?ms)^```.*?^```$", "", page.read_text("utf-8"))
    return {generate.slug(title.strip()) for title in re.findall(r"(?m)^#+ (.+)$", text)}


@pytest.mark.parametrize("page", COMMITTED, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_no_link_of_a_committed_page_is_dead_in_a_clone(page: Path) -> None:
    """A clone has no generated page; the site links what names them (docs/generate.py)."""
    for name, anchor in LINK.findall(without_code(page)):
        target = Path(os.path.normpath(page.parent / name)) if name else page
        assert target.exists(), name
        assert target not in {generate.API, generate.LISTS}, name
        if anchor and target.suffix == ".md":
            assert anchor in anchors(target), f"{name}#{anchor}"


def test_the_site_links_what_names_a_generated_page() -> None:
    """`mkdocs build --strict` says whether the links of the site lead somewhere."""

    class Page:
        class file:  # noqa: N801 - as MkDocs names it
            src_uri = "oracles.md"

    oracles = generate.on_page_markdown("`wil-campaign list oracles` has keys", Page())
    assert (
        oracles == "[`wil-campaign list oracles`](lists.md#oracles-and-the-keys-of-each) has keys"
    )
    shown = generate.on_page_markdown("[its names](../wil_campaign/api.py)", Page())
    assert shown == "[`wil_campaign/api.py`](api.md)"
    kept = "```sh\n`wil-campaign list oracles`\n```"
    assert generate.on_page_markdown(kept, Page()) == kept
    pages = "".join(page.read_text("utf-8") for page in DOCS.glob("*.md"))
    named = [name for name in generate.PRINTED if name in pages or f"(../{name[1:-1]})" in pages]
    assert named == list(generate.PRINTED), "a page names each"
