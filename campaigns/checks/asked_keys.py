"""Find the keys of `autonomy.with` that an autonomy never asked for while it was built."""

import weakref
from collections.abc import Callable, Mapping

from wil_campaign.worlds.files.documents import closest

_OF_A_KEY = ("__getitem__", "__contains__", "get", "pop", "setdefault")
_OF_ALL = (
    "__iter__",
    "__reversed__",
    "__eq__",
    "__or__",
    "__ror__",
    "keys",
    "values",
    "items",
    "copy",
    "popitem",
)


class AskedKeys(dict[str, object]):
    """A dict that notes in `asked` the keys that were asked for, present or not.

    What looks at the whole dict (a loop, `**`, `dict(...)`) asks for every key.
    """

    def __init__(self, given: Mapping[str, object]) -> None:
        """given: the keys and values."""
        super().__init__(given)
        self.names = tuple(given)
        self.asked: set[object] = set()


def _noting(name: str, *, is_of_all: bool) -> Callable[..., object]:
    """Return the method of a dict that notes what is asked for before it answers."""
    plain: Callable[..., object] = getattr(dict, name)

    def method(asked_keys: AskedKeys, *arguments: object) -> object:
        asked_keys.asked.update(asked_keys.names if is_of_all else arguments[:1])
        return plain(asked_keys, *arguments)

    return method


for _name in (*_OF_A_KEY, *_OF_ALL):
    setattr(AskedKeys, _name, _noting(_name, is_of_all=_name in _OF_ALL))


def unread_keys(
    build: Callable[[dict[str, object]], object], parameters: Mapping[str, object]
) -> dict[str, str]:
    """Build an autonomy; return the keys that it never read, each with the key probably meant.

    Nothing is returned where it is not certain: where the autonomy keeps the dict, and so may read
    it in flight, and where it asked for no key at all, as compiled code reads a dict unseen.
    Raises whatever `build` raises.
    """
    given = AskedKeys(parameters)
    asked, kept = given.asked, weakref.ref(given)
    built = build(given)
    del given
    may_read_later = kept() is not None
    del built
    if may_read_later or not asked:
        return {}
    absent = [key for key in asked if isinstance(key, str) and key not in parameters]
    return {key: closest(key, sorted(absent)) for key in parameters if key not in asked}
