"""The facts of a cluster node: its programs must be those of the machine that sends it runs."""

import os
import platform
from collections.abc import Mapping

from wil_campaign.orchestrator.campaign.folder.manifest import flown_versions
from wil_campaign.orchestrator.installation import (
    code_digest,
    flown_plugins,
    program_commit,
    program_version,
)

_SUBREAPER = "RAY_kill_child_processes_on_worker_exit_with_raylet_subreaper"
"""With this set, Ray also kills guards when a worker ends."""
_TRUE = frozenset({"1", "true"})


def node_facts() -> dict[str, str]:
    """Return the facts of this machine: name, versions, plugins of others, digest of the code."""
    others = ", ".join(f"{name} ({origin})" for name, origin in flown_plugins().items())
    return {
        "node": platform.node(),
        "subreaper": os.environ.get(_SUBREAPER, ""),
        "code": code_digest(),
        "commit": program_commit(),
        "python": platform.python_version(),
        **flown_versions(),
        "plugins": others or "none",
        "wil-campaign": program_version(),
    }


def unfit_text(here: Mapping[str, str], there: Mapping[str, str]) -> str:
    """Return why a node cannot fly for this machine, with the remedy; "" where it can."""
    if there.get("subreaper", "").lower() in _TRUE:
        return (
            f"node {there.get('node', '')} is started with {_SUBREAPER}: with it Ray kills the "
            "guards of vehicles in flight; start the node without it"
        )
    skipped = {"node", "subreaper", "commit"}  # equal code is equal, whatever it came with
    other = [name for name in here if name not in skipped and there.get(name) != here[name]]
    if not other:
        return ""
    differences = ", ".join(
        "its code of wil-campaign differs "
        f"({there.get('commit', 'missing')}, here it is {here['commit']})"
        if name == "code"
        else f"{name} is {there.get(name, 'missing')}, here it is {here[name]}"
        for name in other
    )
    return (
        f"node {there.get('node', '')} would not fly the same: {differences}; install the same "
        "wheel of wil-campaign with the same constraints there"
    )
