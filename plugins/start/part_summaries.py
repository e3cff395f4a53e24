"""What the docstrings of the parts of a campaign file say, apart from each other: summary, keys."""

import inspect
import re
from collections.abc import Iterator

from pydantic import BaseModel


def part_summary(model: type[BaseModel]) -> str:
    """Return the first sentences of a model's docstring, before the descriptions of its keys."""
    text = " ".join(inspect.cleandoc(model.__doc__ or "").split())
    first = next(docstring_key_places(model, text), None)
    return text if first is None else text[: first.start()].strip()


def docstring_key_places(model: type[BaseModel], text: str) -> Iterator[re.Match[str]]:
    """Yield the places of a docstring where `key: ` begins, for keys of the model."""
    keys = {name for name, field in model.model_fields.items()}
    keys |= {field.alias for field in model.model_fields.values() if field.alias}
    for place in re.finditer(r"(?:(?<=[.;] )|^)(\w+(?:, \w+)*): ", text):
        if set(place[1].split(", ")) <= keys:
            yield place
