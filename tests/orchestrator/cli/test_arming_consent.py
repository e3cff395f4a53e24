"""What is settled before vehicles fly that are not our own: refusals, and who is there."""

import asyncio
import io
import os
import pwd
import re
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.ports import free_port
from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, load_campaign
from wil_campaign.campaigns.setup.bench_file import load_benches
from wil_campaign.orchestrator.campaign.flight_options import USUAL, ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.cli import arming_consent, main
from wil_campaign.orchestrator.cli.arming_consent import (
    FlightRefusedError,
    NotConfirmedError,
    ask_to_arm,
    clear_for_flight,
    require_may_arm,
)
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

ROOT = Path(__file__).parents[3]
LINK = "vehicles.real.link=udpin://127.0.0.1:%d"
MAVLINK = "vehicles.real.pose_source=mavlink"


def campaign(*sets: str, mode: str = "wil") -> Campaign:
    return load_campaign(
        ROOT / "campaigns" / "gate.yaml",
        ExpansionOptions(cases=("large",), modes=(mode,), repetitions=1, sets=(MAVLINK, *sets)),
    )


class Speaker:
    """Sends messages to a port, as a vehicle or a ground station; answers who it is."""

    def __init__(self, port: int, *, system: int = 1) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(0.05)
        self._port = port
        self.codec = MavlinkCodec(system_id=system, component_id=1)
        self.vehicle_type, self.autopilot = mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4
        self.version = 0x01120080
        self.garbage = False
        self.armed = False
        self.uid = 77
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    @contextmanager
    def speaking(self) -> Iterator[None]:
        self._thread.start()
        try:
            yield
        finally:
            self._stop.set()
            self._thread.join()
            self._socket.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            self._send(self._heartbeat())
            try:
                data = self._socket.recv(2048)
            except (TimeoutError, ConnectionError):
                continue
            for message in self.codec.parse(data):
                if message.get_type() == "COMMAND_LONG" and message.param1 == 148:
                    self._send(
                        mavlink.MAVLink_autopilot_version_message(
                            0, self.version, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, self.uid
                        )
                    )

    def _heartbeat(self) -> Any:
        mode = 128 if self.armed else 0
        return mavlink.MAVLink_heartbeat_message(self.vehicle_type, self.autopilot, mode, 0, 3, 3)

    def _send(self, message: Any) -> None:
        data = b"\xaa" * 40 if self.garbage else self.codec.pack(message)
        try:
            self._socket.sendto(data, ("127.0.0.1", self._port))
        except ConnectionError:
            return


def refused(*sets: str, **options: Any) -> FlightRefusedError:
    with pytest.raises(FlightRefusedError) as caught:
        clear_for_flight(campaign(*sets), FlightOptions(**{"arm_real": True, **options}))
    return caught.value


def test_embedded_vehicles_need_no_consent() -> None:
    cleared = clear_for_flight(campaign(), FlightOptions(jobs=3))
    assert cleared == ClearedCampaign("virtual", 3, "embedded")
    assert clear_for_flight(campaign(), FlightOptions(clock="wall")).clock == "wall"
    assert refused(jobs=0).code == 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"arm_real": False}, r"real \(udpin://127.0.0.1:14540\): it may be hardware.*--arm-real"),
        ({"jobs": 2}, r"--jobs 2: real \(udpin://127.0.0.1:14540\) can fly one run at a time"),
        ({"clock": "virtual"}, "--clock virtual: real is not embedded"),
    ],
)
def test_missing_consent_is_refused_before_any_contact(options: dict[str, Any], said: str) -> None:
    error = refused(LINK % 14540, **options)
    assert error.code == 2
    assert re.search(said, str(error))


def test_a_vehicle_that_does_not_fly_is_not_asked_for() -> None:
    cleared = clear_for_flight(campaign(LINK % 14540, mode="sim"), FlightOptions())
    assert cleared.clock == "virtual"


def test_a_silent_port_is_reported_within_seconds() -> None:
    port = free_port()
    flown = campaign(LINK % port)
    began_s = time.monotonic()
    with pytest.raises(FlightRefusedError) as caught:
        clear_for_flight(flown, FlightOptions(arm_real=True))
    error = caught.value
    assert error.code == 3
    assert f"udpin://127.0.0.1:{port}: no px4 multicopter with system id 1 within 5 s" in str(error)
    assert "nothing arrived" in str(error)
    assert time.monotonic() - began_s < 20.0


def _gcs(speaker: Speaker) -> None:
    speaker.vehicle_type, speaker.autopilot = mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID


def _old(speaker: Speaker) -> None:
    speaker.version = 0x010B0000


def _plane(speaker: Speaker) -> None:
    speaker.vehicle_type = mavlink.MAV_TYPE_FIXED_WING


def _ardupilot(speaker: Speaker) -> None:
    speaker.autopilot = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA


def _garbage(speaker: Speaker) -> None:
    speaker.garbage = True


def _armed(speaker: Speaker) -> None:
    speaker.armed = True


@pytest.mark.parametrize(
    ("system", "make", "said"),
    [
        (255, _gcs, "heartbeats of system 255 only: this is a ground station's port"),
        (1, _old, "it runs px4 1.11.0-dev, and 1.14 is the oldest that is supported"),
        (1, _plane, "system 1 component 1 is a fixed_wing of px4, and only multicopters"),
        (1, _ardupilot, "system 1 component 1 is ardupilot, and px4 was requested"),
        (7, lambda _: None, "system 7 component 1 is a quadrotor of px4"),
        (1, _garbage, "bytes arrived, and they are not MAVLink"),
        (1, _armed, "real is armed already"),
    ],
)
def test_another_vehicle_that_answers_instead_is_named(
    system: int, make: Callable[[Speaker], None], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Who answers ends the wait; the others are named when it is over.
    within_s = 20.0 if make in (_old, _armed) else 4.0
    monkeypatch.setattr(arming_consent, "_IDENTIFY_S", within_s)
    port = free_port()
    speaker = Speaker(port, system=system)
    make(speaker)
    with speaker.speaking():
        error = refused(LINK % port)
    assert error.code == 3
    assert said in str(error)


def test_a_campaign_has_one_kind_of_real_vehicle() -> None:
    """Its results state one for all runs, and that a surrogate flew in each that used it."""
    port = free_port()
    board = f"board: {{vehicles.real.link: 'udpin://127.0.0.1:{port}'}}"
    mixed = load_campaign(
        ROOT / "campaigns" / "gate.yaml",
        ExpansionOptions(
            modes=("sim", "wil"),
            repetitions=1,
            sets=(
                MAVLINK,
                f"cases={{{board}, model: {{}}}}",
                "accept={model: {wil: 5/5}}",
                "controls={}",
            ),
        ),
    )
    with Speaker(port).speaking(), pytest.raises(FlightRefusedError) as caught:
        clear_for_flight(mixed, FlightOptions(arm_real=True))
    assert caught.value.code == 2
    assert "real is hardware in board and embedded in model" in str(caught.value)
    assert "by --case" in str(caught.value)


def test_only_the_users_of_a_bench_arm_there(tmp_path: Path) -> None:
    file = tmp_path / "hall-a.yaml"
    text = (ROOT / "campaigns" / "benches" / "hall-a.yaml").read_text()
    file.write_text(f"{text}arming: {{users: [anna]}}\n")
    (bench,) = load_benches((file,))
    require_may_arm((bench,), "anna")
    require_may_arm(load_benches((ROOT / "campaigns" / "benches" / "hall-a.yaml",)), "ben")
    with pytest.raises(
        FlightRefusedError, match="hall-a: ben may not arm there, only anna"
    ) as refused:
        require_may_arm((bench,), "ben")
    assert refused.value.code == 2


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("answer", "armed"), [("y\n", True), ("\n", False), ("no\n", False)])
def test_a_person_at_a_terminal_is_asked(
    monkeypatch: pytest.MonkeyPatch, answer: str, armed: bool
) -> None:
    port = free_port()
    screen = Terminal()
    monkeypatch.setattr(sys, "stdin", Terminal(answer))
    monkeypatch.setattr(sys, "stderr", screen)
    speaker = Speaker(port)
    with speaker.speaking():
        if armed:
            cleared = clear_for_flight(campaign(LINK % port), FlightOptions(arm_real=True))
            uids = {f"real at udpin://127.0.0.1:{port}": f"{77:016x}"}
            assert cleared == ClearedCampaign("wall", 1, "hardware", "real", uids=uids)
        else:
            assert "not confirmed" in str(refused(LINK % port))
    said = screen.getvalue()
    assert f"real: px4 1.18.0-beta quadrotor, system 1, board {77:016x}, on udpin" in said
    assert "campaign 'gate', 1 run. Arm real (position unknown) and take off? [y/N]" in said


FENCE = "geofence: {box: {north_m: [-1.5, 3.5], east_m: [-1.5, 1.5], up_m: [-0.5, 2.3]}}"


def actor_campaign(real: int, actor: int) -> Campaign:
    intruder = f"{{link: 'udpin://127.0.0.1:{actor}', autopilot: px4, system_id: 3, {FENCE}}}"
    sets = (
        *("cases={fast: {}}", "accept={fast: {real: 5/5}}", "modes=[real]", "controls={}"),
        *(LINK % real, MAVLINK, f"actors={{intruder: {intruder}}}"),
        "preflight.override={separation: A. Pilot}",
    )
    return load_campaign(
        ROOT / "campaigns" / "avoid.yaml", ExpansionOptions(repetitions=1, sets=sets)
    )


@contextmanager
def two_boards() -> Iterator[Campaign]:
    real, actor = free_port(), free_port()
    one, other = Speaker(real), Speaker(actor, system=3)
    other.uid = 78
    with one.speaking(), other.speaking():
        yield actor_campaign(real, actor)


def clear_both(flown: Campaign) -> ClearedCampaign:
    return clear_for_flight(flown, FlightOptions(arm_real=True, arm_actors=True))


class Typing(Terminal):
    """A screen before which somebody types once a question stands on it."""

    def __init__(self, keyboard: int, text: bytes) -> None:
        super().__init__()
        self._keyboard, self._text = keyboard, text

    def flush(self) -> None:
        super().flush()
        if self.getvalue().endswith("[y/N] "):
            os.write(self._keyboard, self._text)


@pytest.mark.parametrize("answer", ["n", "y"])
def test_what_was_typed_before_the_question_is_no_consent(
    monkeypatch: pytest.MonkeyPatch, answer: str
) -> None:
    """A yes typed in flight had a search arm the next variant with nobody near the vehicle."""
    keyboard, terminal = os.openpty()
    os.write(keyboard, b"y\ny\n")
    with os.fdopen(terminal) as stream:
        monkeypatch.setattr(sys, "stdin", stream)
        monkeypatch.setattr(sys, "stderr", Typing(keyboard, f"{answer}\n".encode()))
        for _ in range(2):  # nor does the first answer's rest answer the second question
            if answer == "y":
                ask_to_arm("campaign 'gate'", 1, ())
                continue
            with pytest.raises(NotConfirmedError):
                ask_to_arm("campaign 'gate'", 1, ())
    os.close(keyboard)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"arm_real": True}, r"^intruder \(udpin.*\): it may be hardware.*only with --arm-actors"),
        ({"arm_actors": True}, r"^real \(udpin.*\): it may be hardware.*only with --arm-real"),
    ],
)
def test_pair_and_actors_are_armed_by_words_of_their_own(given: dict[str, bool], said: str) -> None:
    options = replace(USUAL, **given)  # type: ignore[arg-type]  # by name
    with pytest.raises(FlightRefusedError, match=said) as caught:
        clear_for_flight(actor_campaign(14550, 14560), options)
    assert caught.value.code == 2


def test_boards_that_could_touch_fly_with_a_person_at_a_terminal_alone() -> None:
    with two_boards() as flown, pytest.raises(FlightRefusedError) as caught:
        clear_both(flown)
    assert caught.value.code == 2
    assert "intruder flies beside real, and their fences let them touch" in str(caught.value)
    assert "consent is given by a person at a terminal" in str(caught.value)


@pytest.mark.parametrize(
    ("answers", "armed"), [("intruder\ny\n", True), ("y\ny\n", False), ("intruder\nno\n", False)]
)
def test_the_person_types_the_name_of_the_actor_at_the_real_vehicle(
    monkeypatch: pytest.MonkeyPatch, answers: str, armed: bool
) -> None:
    screen = Terminal()
    monkeypatch.setattr(sys, "stdin", Terminal(answers))
    monkeypatch.setattr(sys, "stderr", screen)
    with two_boards() as flown:
        if armed:
            assert clear_both(flown).hardware == "real and intruder"
        else:
            with pytest.raises(FlightRefusedError, match="not confirmed; nothing was armed"):
                clear_both(flown)
    assert "Type intruder to consent: " in screen.getvalue()


def test_one_board_on_two_links_is_refused() -> None:
    real, twin = free_port(), free_port()
    with Speaker(real).speaking(), Speaker(twin, system=2).speaking():
        sets = (LINK % real, f"vehicles.twin.link=udpin://127.0.0.1:{twin}")
        error = refused(*sets)
    assert error.code == 3
    assert "are one vehicle (uid 000000000000004d)" in str(error)


def test_the_program_says_it_in_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    code = main(["run", "campaigns/gate.yaml", "--set", LINK % 14540, "--set", MAVLINK])
    assert code == 2
    assert "--arm-real" in capsys.readouterr().err


def test_a_driver_with_a_system_id_finds_its_vehicle_on_a_shared_link() -> None:
    """Two vehicles on one link: the one that was asked for is found."""
    from tests.plugins.redundant_links.test_redundant import TwoRadios
    from wil_campaign.foundation.clocks.virtual_loop import run_virtual
    from wil_campaign.vehicles.driver import Driver
    from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
    from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
    from wil_campaign.vehicles.links.memory import memory_pair

    async def scenario() -> int:
        one, far_one = memory_pair()
        two, far_two = memory_pair()
        vehicles = [
            EmbeddedVehicle(
                config=EmbeddedConfig(autopilot="px4", system_id=number), link=far, seed=number
            )
            for number, far in ((1, far_one), (2, far_two))
        ]
        driver = Driver(name="real", link=TwoRadios([one, two]), system_id=2)
        async with vehicles[0], vehicles[1], driver:
            await asyncio.sleep(2.0)
            return (await driver.identify(5.0)).system_id

    assert run_virtual(scenario()) == 2


def test_no_attached_vehicle_is_armed_without_a_place_for_backups(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def unknown(uid: int) -> None:
        raise KeyError(uid)

    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(os, "access", lambda *_: False)
    said = str(refused(LINK % 14540))
    assert "cannot be backed up" in said
    assert said.endswith("set XDG_STATE_HOME to a folder that outlives a reboot")
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    monkeypatch.setattr("wil_campaign.orchestrator.cli.arming_consent.user_name", lambda: "1")
    said = str(refused(LINK % 14540))
    assert "has no home folder for the backups" in said


def test_only_a_campaign_of_attached_vehicles_is_cleared_without_jsbsim(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As on Linux on ARM, where there is no package of it."""
    monkeypatch.setattr(arming_consent, "find_spec", lambda name: None)
    with pytest.raises(FlightRefusedError, match=r"real and twin: .* attach or launch") as caught:
        clear_for_flight(campaign(), USUAL)
    assert caught.value.code == 2
    with pytest.raises(FlightRefusedError, match=r"^twin: "):
        clear_for_flight(campaign("vehicles.real.physics=compiled"), USUAL)
    both = ("vehicles.real.physics=compiled", "vehicles.twin.physics=compiled")
    clear_for_flight(campaign(*both), USUAL)
    with pytest.raises(FlightRefusedError, match="armed only with --arm-real"):
        clear_for_flight(
            campaign(
                LINK % 14540,
                "modes=[real]",
                "accept={large: {real: 5/5}}",
                "controls={}",
                mode="real",
            ),
            USUAL,
        )
