"""Documents that the program writes: whatever text is in one, it can be read again."""

from pathlib import Path

from pydantic_core import from_json

from wil_campaign.foundation.files.document_writer import to_json, write_atomically


def test_a_text_that_utf_8_cannot_hold_leaves_the_document_readable(tmp_path: Path) -> None:
    """As of an error that names a file with bytes of another encoding."""
    path = tmp_path / "result.json"
    write_atomically(path, to_json({"reason": "no file 'caf\udce9.png'"}))
    assert from_json(path.read_bytes()) == {"reason": "no file 'caf?.png'"}
