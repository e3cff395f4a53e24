"""Recipe files: YAML, or the paper's XML, by their suffix."""

from pathlib import Path

from recipes.language.paper_xml import parse_paper_xml
from recipes.language.recipe_document import load_recipe
from recipes.model.recipe import Recipe
from worlds.files.documents import MAX_BYTES, BadInput, Document, Problem, load

_XML = ".xml"


def load_recipe_document(path: Path, name: str | None = None) -> Document:
    """Return a recipe file as a document for `load_recipe`; XML in its YAML form.

    name: what to call it in messages; None: the path. Raises BadInput with every problem found.
    """
    if path.suffix.lower() != _XML:
        return load(path, name)
    called = str(path) if name is None else name
    try:
        with path.open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
    except OSError as error:
        message = f"cannot be read: {error.strerror or error}"
        raise BadInput([Problem(called, 0, 0, message)]) from error
    if len(content) > MAX_BYTES:
        raise BadInput([Problem(called, 0, 0, f"is larger than {MAX_BYTES} bytes")])
    return parse_paper_xml(content, name=called, path=path)


def load_recipe_file(path: Path) -> Recipe:
    """Return the recipe in a file, YAML or XML. Raises BadInput with every problem."""
    return load_recipe(load_recipe_document(path))
