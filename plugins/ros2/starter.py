"""`wil-campaign init --ros2`: the template's campaign, flown by a node."""

from collections.abc import Mapping
from importlib.resources import files

_AUTONOMY = "autonomy: {use: autonomy.py:Autonomy, with: {speed_m_s: 0.5}}\n"
_NODE = """\
autonomy:
  ros2:
    command: [python3, node.py]             # or run: [PACKAGE, EXECUTABLE], or launch: FILE
    needs: [/camera/image_raw]
    barrier: {topics: [/camera/image_raw]}  # virtual time waits for the answer to each image
"""
_VALIDATE = "      - run: wil-campaign validate"
_EXTRA = "      - run: pip install 'wil-campaign[ros2]'\n"


def node_files(texts: Mapping[str, str]) -> dict[str, str]:
    """Return the files of a campaign with a node of those of the template. texts: by file name."""
    workflow = next(name for name in texts if name.endswith(".yml"))
    node = (files("wil_campaign.plugins.ros2") / "starter_node.py.in").read_text("utf-8")
    changed = {
        "campaign.yaml": texts["campaign.yaml"].replace(_AUTONOMY, _NODE),
        "node.py": node,
        workflow: texts[workflow].replace(_VALIDATE, _EXTRA + _VALIDATE),
    }
    return {name: text for name, text in texts.items() if name != "autonomy.py"} | changed
