"""Read recipes in the XML form of the paper (Listing 1) into the document of the YAML form.

`<AS_sensors>` lists the sensors, each with an `id`; `<combine id="...">` names a file for each of
`<transform>`, `<filter>` and `<merge>`. A file beside the recipe is the user's own step, its
function named after the stage; otherwise it is the built-in of that stem. Attributes are
parameters, written as in YAML: `<filter name="orange">isolate_color.py</filter>`; those of
`<combine>` are its other keys: `max_skew_ms="60" publish="[real]"`. A stage may be given several
times, in order.

Parse XML into elements with their places; document types and entities are refused.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from xml.parsers import expat

from wil_campaign.foundation.files.documents import (
    BadInput,
    Document,
    Problem,
    closest_word,
    parse_option_value,
)
from wil_campaign.foundation.files.paths import is_file
from wil_campaign.foundation.files.yaml_nodes import (
    MAX_DEPTH,
    Data,
    YamlEntry,
    YamlNode,
    YamlPlace,
    YamlSource,
    mapping_node,
    plain_value_of_node,
    sequence_node,
)
from wil_campaign.recipes.model.registry import Stage, find_step, resembling_step


@dataclass(slots=True)
class XmlElement:
    """An XML element with places. text: all text in it, trimmed; text_place: where that begins."""

    tag: str
    attributes: dict[str, str]
    place: YamlPlace
    children: list["XmlElement"] = field(default_factory=list)
    text: str = ""
    text_place: YamlPlace | None = None


def parse_xml(content: bytes, source: YamlSource) -> XmlElement:
    """Return the root element of an XML text. Raises BadInput.

    Raises BadInput for what is not well-formed, has a document type, or is nested too deep.
    """
    builder = _Builder(source)
    try:
        builder.parser.Parse(content, True)
    except expat.ExpatError as error:
        place = YamlPlace(source, error.lineno, error.offset + 1)
        message = f"not XML: {expat.errors.messages[error.code]}"
        raise BadInput([place.problem(message)]) from error
    except (ValueError, LookupError) as error:
        raise BadInput([YamlPlace(source).problem(f"not XML: {error}")]) from error
    if builder.root is None:
        raise BadInput([YamlPlace(source).problem("is empty")])
    return builder.root


class _Builder:
    """Builds the tree of XML elements from expat's events."""

    def __init__(self, source: YamlSource) -> None:
        self.root: XmlElement | None = None
        self.parser = expat.ParserCreate()
        self._source = source
        self._open: list[XmlElement] = []
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._doctype

    def _place(self) -> YamlPlace:
        column = self.parser.CurrentColumnNumber + 1
        return YamlPlace(self._source, self.parser.CurrentLineNumber, column)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        """Open an XML element. Raises BadInput when nested too deep."""
        if len(self._open) >= MAX_DEPTH:
            raise BadInput([self._place().problem(f"nested more than {MAX_DEPTH} deep")])
        element = XmlElement(tag, attributes, self._place())
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)

    def _end(self, _tag: str) -> None:
        element = self._open.pop()
        element.text = element.text.strip()

    def _text(self, text: str) -> None:
        """Add text to the open XML element."""
        element = self._open[-1]
        if element.text_place is None and text.strip():
            here = self._place()
            skipped = len(text) - len(text.lstrip())
            column = here.column + (0 if "\n" in text[:skipped] else skipped)
            element.text_place = YamlPlace(here.source, here.line, column)
        element.text += text

    def _doctype(self, *_: object) -> None:
        """Refuse a document type in the XML text."""
        raise BadInput([self._place().problem("a document type is not used in these files")])


_TYPES: Mapping[str, str] = MappingProxyType(
    {
        "camera": "camera",
        "depth": "depth",
        "depthcamera": "depth",
        "lidar": "lidar",
        "pointcloud": "lidar_points",
        "lidarpoints": "lidar_points",
        "rangefinder": "rangefinder",
        "gps": "gps",
        "pose": "pose",
        "mocap": "pose",
        "imu": "imu",
        "microphone": "microphone",
    }
)
"""Tags of sensors, in lower case and without underscores, to our types."""

_PAPERS_OWN: Mapping[str, tuple[str, Mapping[str, Data]]] = MappingProxyType(
    {
        "camera.transform": ("resize", MappingProxyType({"to": "real"})),
        "color_isolation": ("isolate_color", MappingProxyType({"name": "orange"})),
        "prioritize_overlay": ("overlay", MappingProxyType({"priority": ["twin", "real"]})),
    }
)
"""Stems of the paper's listing, to the built-in step and its parameters (paper, III-A)."""

_LISTED: tuple[Stage, ...] = ("transform", "filter")

_STAGES: Mapping[str, Stage] = MappingProxyType(
    {"transform": "transform", "filter": "filter", "merge": "merge"}
)


def parse_paper_xml(content: bytes, *, name: str, path: Path | None = None) -> Document:
    """Return the document of an XML recipe of the paper. Raises BadInput with every problem.

    Steps and sensors are checked by `load_recipe`, with places in the XML.
    """
    lines = tuple(content.decode("utf-8", "replace").splitlines())
    source = YamlSource(name, lines)
    root = parse_xml(content, source)
    reader = _Reader(path if path is not None else Path(name))
    node = reader.recipe(root)
    if reader.problems:
        raise BadInput(sorted(reader.problems, key=lambda one: (one.line, one.column)))
    return Document(reader.path, node)


class _Reader:
    """Converts the XML elements of a paper's recipe into YAML nodes, noting problems."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.problems: list[Problem] = []

    def recipe(self, root: XmlElement) -> YamlNode:
        """Return the whole XML recipe in its YAML form."""
        if root.tag != "recipe_file":
            self._note(root.place, f"the outermost tag is <{root.tag}>, not <recipe_file>")
        self._refuse_text(root)
        sensors: dict[str, YamlEntry] = {}
        combinations: list[YamlNode] = []
        for child in root.children:
            if child.tag == "AS_sensors":
                self._refuse_text(child)
                for key in child.attributes:
                    self._note(child.place, f"attribute '{key}': each sensor has its own")
                for sensor in child.children:
                    self._sensor(sensor, sensors)
            elif child.tag == "combine":
                combinations.append(self._combination(child))
            else:
                self._unknown(child, ("AS_sensors", "combine"))
        entries = {"schema": _entry("wil/recipe/1", root.place)}
        entries |= self._attributes(root, ())
        entries["sensors"] = YamlEntry(root.place, mapping_node(sensors, root.place))
        entries["combine"] = YamlEntry(root.place, sequence_node(tuple(combinations), root.place))
        return mapping_node(entries, root.place)

    def _sensor(self, element: XmlElement, sensors: dict[str, YamlEntry]) -> None:
        kind = _TYPES.get(element.tag.lower().replace("_", ""))
        if kind is None:
            meant = closest_word(element.tag, [*_TYPES])
            self._note(element.place, f"<{element.tag}> is not a sensor", meant)
            return
        self._refuse_text(element)
        self._refuse_children(element)
        name = self._id(element)
        if name in sensors:
            self._note(element.place, f"sensor '{name}' is declared twice")
        entries = {"type": _entry(kind, element.place)} | self._attributes(element, ("id",))
        sensors[name] = YamlEntry(element.place, mapping_node(entries, element.place))

    def _combination(self, element: XmlElement) -> YamlNode:
        """Return the combination of an XML element: its steps by stage, and its merge."""
        self._refuse_text(element)
        entries = {"sensor": _entry(self._id(element), element.place)}
        entries |= self._attributes(element, ("id",))
        found: dict[Stage, list[YamlNode]] = {"transform": [], "filter": [], "merge": []}
        for child in element.children:
            stage = _STAGES.get(child.tag)
            if stage is None:
                self._unknown(child, tuple(_STAGES))
                continue
            if stage == "merge" and found["merge"]:
                self._note(child.place, "a second <merge>; a combination has one")
            found[stage].append(self._step(child, stage))
        for listed in _LISTED:
            steps = tuple(found[listed])
            entries[listed] = YamlEntry(element.place, sequence_node(steps, element.place))
        if found["merge"]:
            merge = found["merge"][0]
            entries["merge"] = YamlEntry(merge.place, merge)
        return mapping_node(entries, element.place)

    def _step(self, element: XmlElement, stage: Stage) -> YamlNode:
        """Return the step that a file name in the XML recipe denotes."""
        self._refuse_children(element)
        place = element.text_place or element.place
        file = element.text
        given = self._attributes(element, ())
        if not file.endswith(".py"):
            self._note(place, f"<{stage}> names a file.py, not '{file}'")
            return YamlNode(None, place)
        if is_file(self.path.parent / file):
            return _own(file, stage, given, place)
        stem = file[: -len(".py")]
        name, defaults = _PAPERS_OWN.get(stem, (stem, MappingProxyType({})))
        kind = find_step(name, stage)
        if kind is None or kind.stage != stage:
            message = (
                f"there is no file '{file}' beside the recipe, and no built-in {stage} '{stem}'"
            )
            papers = closest_word(stem, _PAPERS_OWN)
            self._note(place, message, f"{papers}.py" if papers else resembling_step(stem, stage))
            return YamlNode(None, place)
        parameters = {key: _entry(value, place) for key, value in defaults.items()} | given
        if not parameters:
            return YamlNode(name, place)
        return mapping_node({name: YamlEntry(place, mapping_node(parameters, place))}, place)

    def _refuse_text(self, element: XmlElement) -> None:
        """Note text of an XML element that has none."""
        if element.text:
            place = element.text_place or element.place
            self._note(place, f"<{element.tag}> has no text of its own: '{element.text:.40}'")

    def _refuse_children(self, element: XmlElement) -> None:
        """Note elements in an XML element that has parameters as attributes alone."""
        for child in element.children:
            attribute = f'{child.tag}="{child.text:.40}"'
            self._note(child.place, f"<{child.tag}> in <{element.tag}>: write it as {attribute}")

    def _id(self, element: XmlElement) -> str:
        """Return the id of an XML element; a missing one is noted."""
        name = element.attributes.get("id", "").strip()
        if not name:
            self._note(element.place, f"<{element.tag}> needs an id")
        return name

    def _attributes(self, element: XmlElement, without: tuple[str, ...]) -> dict[str, YamlEntry]:
        found: dict[str, YamlEntry] = {}
        for key, text in element.attributes.items():
            if key in without:
                continue
            try:
                value = plain_value_of_node(parse_option_value(text, name=key).node)
            except BadInput as error:
                message = f"attribute '{key}': {error.problems[0].message}"
                self._note(element.place, message)
                continue
            found[key] = _entry(value, element.place)
        return found

    def _unknown(self, element: XmlElement, known: tuple[str, ...]) -> None:
        """Note an unknown tag of the XML recipe."""
        self._note(element.place, f"unknown tag <{element.tag}>", closest_word(element.tag, known))

    def _note(self, place: YamlPlace, message: str, suggestion: str = "") -> None:
        self.problems.append(place.problem(message, suggestion))


def _own(file: str, stage: Stage, given: dict[str, YamlEntry], place: YamlPlace) -> YamlNode:
    """Return the XML recipe's step of a user's file; attributes other than `on` are its `with`."""
    entries = {"use": _entry(f"{file}:{stage}", place)}
    if "on" in given:
        entries["on"] = given.pop("on")
    if given:
        entries["with"] = YamlEntry(place, mapping_node(given, place))
    return mapping_node(entries, place)


def _entry(value: Data, place: YamlPlace) -> YamlEntry:
    """Return a plain value of the XML recipe as an entry of the YAML form."""
    return YamlEntry(place, _node(value, place))


def _node(value: Data, place: YamlPlace) -> YamlNode:
    """Return a plain value of the XML recipe as a YAML node."""
    if isinstance(value, dict):
        return mapping_node({key: _entry(inner, place) for key, inner in value.items()}, place)
    if isinstance(value, list):
        return sequence_node(tuple(_node(inner, place) for inner in value), place)
    return YamlNode(value, place)
