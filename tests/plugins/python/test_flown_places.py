"""Programs and pytest fly on benches and by engines, under the rules of consent of `run`."""

from collections.abc import Callable
from pathlib import Path

import pytest

import wil_campaign
from tests.orchestrator.conftest import workers_forked
from tests.orchestrator.hover import write_hover
from tests.plugins.cluster.bench.test_bench_engine import BENCH, write_bench, write_campaign
from tests.plugins.cluster.bench.test_bench_flight import vehicle_at
from tests.plugins.pytest.test_pytest_plugin import ARGUMENTS
from tests.ports import free_port
from wil_campaign.orchestrator.campaign.folder.bench_lock import held_benches
from wil_campaign.plugins.pytest import pytest_items
from wil_campaign.plugins.python import flying


def refusal(fly: Callable[[], object]) -> tuple[str, int]:
    with pytest.raises(wil_campaign.CannotFlyError) as caught:
        fly()
    return str(caught.value), caught.value.exit_code


@pytest.fixture(autouse=True)
def _own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.mark.no_turn("flies nothing")
def test_a_program_says_what_a_bench_of_this_machine_needs(
    tmp_path: Path, fork_server: None
) -> None:
    port = free_port()
    path, bench = write_campaign(tmp_path), write_bench(tmp_path, port)
    file, out = bench.document.path, tmp_path / "out"
    with workers_forked():
        (problem,) = wil_campaign.validate(path)
        assert "asks for a bench" in problem.message
        assert wil_campaign.validate(path, bench_files=[file]) == ()
    campaign = wil_campaign.load(path, bench_files=[file])
    said, code = refusal(lambda: wil_campaign.run(path, out=out, bench_files=[str(file)]))
    assert ("--arm-real" in said, code) == (True, 2)
    with held_benches((bench,)):  # it is not asked for its vehicle either, which is in flight
        said, code = refusal(lambda: wil_campaign.run(campaign, out=out, arm_real=True))
    assert ("bench hall-a is in use" in said, code) == (True, 3)
    assert not out.exists()


def test_a_program_flies_on_a_bench_of_this_machine_with_consent_alone(
    tmp_path: Path, fork_server: None
) -> None:
    port = free_port()
    path, bench = write_campaign(tmp_path), write_bench(tmp_path, port)
    with vehicle_at(port), workers_forked():
        campaign = wil_campaign.load(path, repetitions=1, bench_files=[bench.document.path])
        flown = wil_campaign.run(campaign, out=tmp_path / "out", arm_real=True)
    (run,) = flown.runs
    assert (run.mode, run.verdict, flown.summary.real_kind) == ("real", "PASS", "sitl"), run.reason


@pytest.mark.no_turn("flies nothing")
def test_a_user_without_the_right_to_arm_cannot_arm_a_bench_by_a_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop = flying.FlightProcess.stop

    def stop_once_it_has_ended(process: flying.FlightProcess) -> None:
        process._process.wait()
        stop(process)

    monkeypatch.setattr(flying.FlightProcess, "stop", stop_once_it_has_ended)
    path, file = write_campaign(tmp_path), tmp_path / "hall-a.yaml"
    file.write_text(BENCH % 14540 + "arming: {users: [nobody-of-here]}\n")
    fly = wil_campaign.run
    said, code = refusal(lambda: fly(path, out=tmp_path, arm_real=True, bench_files=[file]))
    assert ("may not arm there, only nobody-of-here" in said, code) == (True, 2)


@pytest.mark.no_turn("flies nothing")
def test_a_program_names_an_engine(tmp_path: Path) -> None:
    asking, hover = write_campaign(tmp_path), tmp_path / "plain"
    hover.mkdir()
    path, out = write_hover(hover), tmp_path / "out"
    said, code = refusal(lambda: wil_campaign.run(path, out=out, engine="rai"))
    assert ("must be local, ray or ray://HOST:PORT" in said, code) == (True, 2)
    # The file of a campaign for a bench of a cluster is not read before that bench is there.
    said, code = refusal(lambda: wil_campaign.run(asking, out=out, engine="ray"))
    assert ("a Ray of this machine alone has no benches" in said, code) == (True, 2)
    with pytest.raises(ValueError, match="give them to load"):
        wil_campaign.run(wil_campaign.load(path), out=out, bench_files=[path])
    assert not out.exists()


@pytest.fixture
def inner(pytester: pytest.Pytester) -> pytest.Pytester:
    pytester.makeini("[pytest]\nasyncio_default_fixture_loop_scope = function\n")
    return pytester


@pytest.mark.no_turn("flies nothing")
def test_pytest_takes_benches_and_an_engine(
    inner: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_campaign(inner.path)
    write_bench(inner.path)
    given: list[tuple[str, bool, list[str]]] = []

    def refuse(campaign: wil_campaign.Campaign, options: wil_campaign.FlightOptions) -> None:
        benches = [bench.name for bench in campaign.options.benches]
        given.append((options.engine, options.arm_real, benches))
        raise wil_campaign.CannotFlyError("not now", 2)

    monkeypatch.setattr(pytest_items, "run", refuse)
    words = (*ARGUMENTS, "hover.yaml")
    bench = ("--wil-bench-file", "hall-a.yaml")
    without = inner.runpytest_inprocess(*words)
    without.stdout.fnmatch_lines(["*asks for a bench*"])
    over = inner.runpytest_inprocess(*words, "--wil-engine", "ray://127.0.0.1:1")
    over.stdout.fnmatch_lines(["*pytest names runs before a bench of a cluster is known*"])
    inner.runpytest_inprocess(*words, *bench, "--wil-engine", "ray").assert_outcomes(errors=2)
    assert given == [("ray", False, ["hall-a"])]
