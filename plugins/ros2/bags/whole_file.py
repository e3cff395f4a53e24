"""A file that has its name once it is whole."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from wil_campaign.foundation.files.document_writer import sync_folder


@contextmanager
def whole_file(path: Path) -> Iterator[IO[bytes]]:
    """Open a file that has its name once it is whole, and is not there otherwise."""
    prefix, suffix = f".{path.name}.", ".part"
    with tempfile.NamedTemporaryFile(
        dir=path.parent, prefix=prefix, suffix=suffix, delete=False
    ) as stream:
        part = Path(stream.name)
        try:
            yield stream
            stream.flush()
            part.chmod(0o644)
            part.rename(path)
        finally:
            part.unlink(missing_ok=True)
    sync_folder(path.parent)
