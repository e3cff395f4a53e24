"""The oracles that campaigns may name: the core's, and those of plugins."""

from collections.abc import Mapping
from functools import cache

from wil_campaign.hooks import oracles
from wil_campaign.installed_plugins import loaded_additions
from wil_campaign.safety.oracles.oracle import OracleSpec


@cache
def oracle_kinds() -> Mapping[str, OracleSpec]:
    """Return all kinds of oracles by name, ordered by their files.

    Raises BadInput for a plugin that cannot be used.
    """
    found: Mapping[str, OracleSpec] = loaded_additions(oracles, "spec")
    return dict(sorted(found.items(), key=lambda item: _file_of(item[1])))


def own_oracle_keys() -> Mapping[str, str]:
    """Return by key the kind of oracle that has a name of the user's where this key is given."""
    kinds = oracle_kinds().values()
    return {kind.own_key.key: kind.name for kind in kinds if kind.own_key is not None}


def _file_of(spec: OracleSpec) -> str:
    return spec.factory.__module__.rpartition(".")[2]
