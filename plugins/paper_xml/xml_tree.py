"""Parse XML into elements with their places; document types and entities are refused."""

from dataclasses import dataclass, field
from xml.parsers import expat

from wil_campaign.worlds.files.documents import BadInput
from wil_campaign.worlds.files.yaml_nodes import MAX_DEPTH, Place, Source


@dataclass(slots=True)
class Element:
    """An XML element with places. text: all text in it, trimmed; text_place: where that begins."""

    tag: str
    attributes: dict[str, str]
    place: Place
    children: list["Element"] = field(default_factory=list)
    text: str = ""
    text_place: Place | None = None


def parse_xml(content: bytes, source: Source) -> Element:
    """Return the root element of an XML text. Raises BadInput.

    Raises BadInput for what is not well-formed, has a document type, or is nested too deep.
    """
    builder = _Builder(source)
    try:
        builder.parser.Parse(content, True)
    except expat.ExpatError as error:
        place = Place(source, error.lineno, error.offset + 1)
        message = f"not XML: {expat.errors.messages[error.code]}"
        raise BadInput([place.problem(message)]) from error
    except (ValueError, LookupError) as error:
        raise BadInput([Place(source).problem(f"not XML: {error}")]) from error
    if builder.root is None:
        raise BadInput([Place(source).problem("is empty")])
    return builder.root


class _Builder:
    """Builds the tree of XML elements from expat's events."""

    def __init__(self, source: Source) -> None:
        self.root: Element | None = None
        self.parser = expat.ParserCreate()
        self._source = source
        self._open: list[Element] = []
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._doctype

    def _place(self) -> Place:
        column = self.parser.CurrentColumnNumber + 1
        return Place(self._source, self.parser.CurrentLineNumber, column)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        """Open an XML element. Raises BadInput when nested too deep."""
        if len(self._open) >= MAX_DEPTH:
            raise BadInput([self._place().problem(f"nested more than {MAX_DEPTH} deep")])
        element = Element(tag, attributes, self._place())
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
            element.text_place = Place(here.source, here.line, column)
        element.text += text

    def _doctype(self, *_: object) -> None:
        """Refuse a document type in the XML text."""
        raise BadInput([self._place().problem("a document type is not used in these files")])
