"""Documents that the program writes: whatever text is in one, it can be read again."""

import os
from pathlib import Path

from pydantic_core import from_json

from wil_campaign.foundation.files.document_writer import (
    require_own_file,
    to_json,
    write_atomically,
)


def test_a_text_that_utf_8_cannot_hold_leaves_the_document_readable(tmp_path: Path) -> None:
    """As of an error that names a file with bytes of another encoding."""
    path = tmp_path / "result.json"
    write_atomically(path, to_json({"reason": "no file 'caf\udce9.png'"}))
    assert from_json(path.read_bytes()) == {"reason": "no file 'caf?.png'"}


def test_what_is_no_file_is_written_into_and_not_replaced(tmp_path: Path) -> None:
    """As root, `report --out /dev/null` made a file of the device."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    require_own_file(pipe, b"page")  # is not waited for
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_atomically(pipe, "page")
    assert os.read(reader, 100) == b"page"
    os.close(reader)
    assert pipe.is_fifo()
