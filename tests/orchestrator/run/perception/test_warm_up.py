"""What the run server loads before it forks: kernels that are on disk, and none that are not."""

from pathlib import Path

import pytest

from orchestrator.run.perception import warm_up
from vehicles.embedded.control.law import load_kernels
from vehicles.embedded.physics.motion_kernel import estimate
from worlds import jit


def test_a_kernel_is_cached_once_it_was_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load_kernels()
    assert jit.is_cached(estimate)
    monkeypatch.setattr(jit, "cache_folder", lambda _: tmp_path)
    assert not jit.is_cached(estimate)
    monkeypatch.setattr(jit, "cache_folder", lambda _: None)
    assert not jit.is_cached(estimate)


@pytest.mark.parametrize("kept", [(), ("estimate",), ("write_ids",), ("estimate", "write_ids")])
def test_the_run_server_compiles_nothing(
    monkeypatch: pytest.MonkeyPatch, kept: tuple[str, ...]
) -> None:
    loaded: list[str] = []
    monkeypatch.setattr(warm_up, "is_cached", lambda kernel: kernel.__name__ in kept)
    monkeypatch.setattr(warm_up, "load_kernels", lambda: loaded.append("estimate"))
    monkeypatch.setattr(warm_up, "load_rendering", lambda: loaded.append("write_ids"))
    warm_up.load_kept_kernels()
    assert tuple(loaded) == kept
