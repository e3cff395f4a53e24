"""What a process that ended said last."""

from pathlib import Path

import pytest

from wil_campaign.foundation.processes.last_output import last_output

TRACEBACK = """\
[INFO] [corridor]: flying
Traceback (most recent call last):
  File "/ws/src/corridor_node.py", line 140, in <module>
    main()
    ~~~~^^
  File "/opt/ros/lib/python3.12/site-packages/rclpy/__init__.py", line 244, in spin
    executor.spin_once()
  File "/ws/src/corridor_node.py", line 110, in on_odom
    raise RuntimeError("my planner lost its map")
  File "/opt/ros/lib/python3.12/site-packages/rclpy/task.py", line 9, in call
    inner()
RuntimeError: my planner lost its map
"""
SAID = "RuntimeError: my planner lost its map (corridor_node.py line 110, on_odom)"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (TRACEBACK, SAID),
        (TRACEBACK + "[ros2run]: Process exited with failure 1\n", SAID),
        ("x" * 9000 + "\n" + TRACEBACK, SAID),
        (TRACEBACK + "went on\n" * 5 + "no  map\n", "went on; went on; no map"),
        ("one\n\ntwo\nthree\nfour\n", "two; three; four"),
        ('  File "cut.py", line 3, in off\n', 'File "cut.py", line 3, in off'),
        ("\x1b[31m[ERROR] [x]:\tlost\x1b[0m\n", "[ERROR] [x]: lost"),
        ("cleared \x1b[2J\0the screen\n", "cleared ?[2J?the screen"),
        ("x" * 9000, "x" * 500),
        ("", ""),
    ],
)
def test_a_traceback_is_shortened_to_its_exception_and_place(
    tmp_path: Path, text: str, said: str
) -> None:
    log = tmp_path / "twin-node.log"
    log.write_text(text, encoding="utf-8")
    assert last_output(log) == said
    assert last_output(tmp_path / "none.log") == ""
