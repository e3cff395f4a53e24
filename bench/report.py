"""Time and size of the report of a campaign of many runs: a recorded folder, its runs repeated.

    python bench/report.py results/gate/20261122T094921Z 90

Runs are links to those recorded, so that reading costs what it costs and the disk holds them once.
There is no summary: it would name runs that are not there.
"""

import json
import sys
import tempfile
import time
from pathlib import Path

from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.report.campaign_report import write_report

TARGET_S, TARGET_BYTES = 20.0, 25_000_000


def repeat(recorded: Path, count: int, folder: Path) -> None:
    """Write a folder with as many runs, each a link to a recorded one in turn."""
    entries = [
        entry for entry in read_campaign_documents(recorded).entries if entry.result is not None
    ]
    manifest = json.loads((recorded / "campaign.json").read_text("utf-8"))
    names = []
    for number in range(count):
        entry = entries[number % len(entries)]
        name = f"{entry.case}/{entry.mode}/{number + 1}"
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).symlink_to((recorded / entry.name).resolve(), target_is_directory=True)
        names.append(name)
    manifest["runs"] = [{"run": name} for name in names]
    (folder / "campaign.json").write_text(json.dumps(manifest), "utf-8")


def main() -> int:
    recorded, count = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 90
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        repeat(recorded, count, folder)
        begin_s = time.perf_counter()
        written = write_report(folder)
        took_s = time.perf_counter() - begin_s
        size = written.path.stat().st_size
    print(f"{count} runs: {took_s:.1f} s (at most {TARGET_S:g}), {size / 1e6:.1f} MB (at most 25)")
    for text in written.problems[:5]:
        print(text)
    return 0 if took_s <= TARGET_S and size <= TARGET_BYTES else 1


if __name__ == "__main__":
    sys.exit(main())
