"""The detector of persons and quadrotors that comes with the program.

bench/train_detector.py trained it on images of this program's renderer; docs/detector.md lists
what it finds and misses. It is not for photographs.
"""

from pathlib import Path

from wil_campaign.plugins.detector.detector import OnnxDetector

NAMES = ("person", "quadrotor")
_FILE = Path(__file__).parent / "models" / "person-quadrotor.onnx"
_INPUT_PX = (320, 240)


def shipped_detector(*, threshold: float = 0.5) -> OnnxDetector:
    """Return the shipped detector; threshold: least score, 0 to 1."""
    return OnnxDetector(_FILE, names=NAMES, input_px=_INPUT_PX, threshold=threshold)
