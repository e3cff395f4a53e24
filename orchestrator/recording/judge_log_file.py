"""The judge log file judged.msgpack: all samples of a run's oracles, to judge it again."""

from pathlib import Path
from typing import Self

from wil_campaign.foundation.background_file import BackgroundFile
from wil_campaign.safety.evaluation.judge_log import JudgeLogPacker, LoggedSample

FILE_NAME = "judged.msgpack"


class JudgeLogWriter:
    """Writes the judge log file: samples in the judge's order; a context manager."""

    def __init__(self, *, path: Path) -> None:
        self._path = path
        self._packer = JudgeLogPacker()

    def __enter__(self) -> Self:
        self._file = BackgroundFile(self._path)
        self._file.write(self._packer.header())
        self._last_flush_s = 0.0
        return self

    def write(self, sample: LoggedSample) -> None:
        """Append one sample to the judge log file."""
        self._file.write(self._packer.pack(sample))
        if sample.t_s - self._last_flush_s >= 1.0:
            self._last_flush_s = sample.t_s
            self._file.flush()

    def __exit__(self, *_: object) -> None:
        self._file.close()
