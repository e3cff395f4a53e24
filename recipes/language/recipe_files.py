"""Recipe files: YAML, or what the suffix of a plugin's format says, such as the paper's XML."""

from collections.abc import Callable
from pathlib import Path

from wil_campaign.foundation.files.documents import (
    MAX_BYTES,
    BadInput,
    Document,
    Problem,
    load_document,
)
from wil_campaign.hooks import recipe_formats
from wil_campaign.installed_plugins import absent_additions, plugin_additions
from wil_campaign.installed_plugins import load_plugin_object as load_name
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.model.recipe import Recipe


def load_recipe_document(path: Path, name: str | None = None) -> Document:
    """Return a recipe file as a document for `load_recipe`; in its YAML form.

    name: what to call it in messages; None: the path. Raises BadInput with every problem found.
    """
    suffix, called = path.suffix.lower(), str(path) if name is None else name
    if why := absent_additions(recipe_formats).get(suffix):
        raise BadInput([Problem(called, 0, 0, why)])
    if (recipe_format := plugin_additions(recipe_formats).get(suffix)) is None:
        return load_document(path, name)
    try:
        with path.open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
    except OSError as error:
        message = f"cannot be read: {error.strerror or error}"
        raise BadInput([Problem(called, 0, 0, message)]) from error
    if len(content) > MAX_BYTES:
        raise BadInput([Problem(called, 0, 0, f"is larger than {MAX_BYTES} bytes")])
    parse: Callable[..., Document] = load_name(recipe_format.parse)
    return parse(content, name=called, path=path)


def load_recipe_file(path: Path) -> Recipe:
    """Return the recipe in a file, of any format. Raises BadInput with every problem."""
    return load_recipe(load_recipe_document(path))
