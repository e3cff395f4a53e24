"""For all tests: properties are searched without a deadline, for these machines are shared."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("here", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "here")


@pytest.fixture
def short_folder() -> Iterator[Path]:
    """A folder for sockets: beneath pytest's own their paths are too long."""
    folder = Path(tempfile.mkdtemp(prefix="wil-"))
    yield folder
    shutil.rmtree(folder)
