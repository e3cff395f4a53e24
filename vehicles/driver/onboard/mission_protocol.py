"""The ground station's side of the mission protocol: uploads, reads back and clears item lists.

https://mavlink.io/en/services/mission.html
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Self

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.mavlink.names import enum_name

_ACCEPTED, _BUSY = mavlink.MAV_MISSION_ACCEPTED, mavlink.MAV_MISSION_ERROR
STATUSTEXT_WAIT_S = 0.3
"""How long to wait for the STATUSTEXT that explains a refusal: it comes after it."""
_MOST_REPEATS = 30
"""So many requests without progress end an upload: a bad radio takes fewer, as autopilots give up
after seconds."""
_PARAM_TOLERANCE = 1e-4
_PLACE_TOLERANCE = 1
"""PX4 keeps degrees as doubles: what comes back may be one unit (1e-7 degrees) off."""


class MissionError(VehicleError):
    """A mission, fence or rally list was refused, or came back changed."""


class UnsureUploadError(MissionError):
    """All items of a list were sent, and whether it was accepted is unknown."""


class UnsupportedListError(MissionError):
    """The autopilot has no such list."""


class ItemList(IntEnum):
    """Which list of the mission protocol: MAV_MISSION_TYPE."""

    MISSION = mavlink.MAV_MISSION_TYPE_MISSION
    FENCE = mavlink.MAV_MISSION_TYPE_FENCE
    RALLY = mavlink.MAV_MISSION_TYPE_RALLY


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionItem:
    """A mission item as transmitted: x, y in 1e-7 degrees (global) or 1e-4 m; z in metres.

    command is its MAV_CMD, frame its MAV_FRAME.
    """

    command: int
    frame: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    x: int = 0
    y: int = 0
    z: float = 0.0
    autocontinue: bool = True

    @classmethod
    def of(cls, raw: Any) -> Self:
        """Return the mission item in a MISSION_ITEM_INT, or in a RawItem of mavsdk."""
        return cls(
            command=raw.command,
            frame=raw.frame,
            params=(raw.param1, raw.param2, raw.param3, raw.param4),
            x=raw.x,
            y=raw.y,
            z=raw.z,
            autocontinue=bool(raw.autocontinue),
        )

    def agrees(self, other: "MissionItem") -> bool:
        """Return whether an autopilot may return one mission item for the other."""
        return (
            self.command == other.command
            and abs(self.x - other.x) <= _PLACE_TOLERANCE
            and abs(self.y - other.y) <= _PLACE_TOLERANCE
            and _near(self.z, other.z)
            and all(map(_near, self.params, other.params))
        )


class MissionProtocol:
    """Uploads and downloads the vehicle's mission lists, one operation at a time.

    An unanswered message is sent again every `timeout_s`, `tries` times. circumstances: returns
    text that is added to errors (the last STATUSTEXTs).
    """

    def __init__(
        self,
        *,
        session: MavlinkSession,
        circumstances: Callable[[], str] = str,
        timeout_s: float = 0.7,
        tries: int = 6,
    ) -> None:
        self._session = session
        self._circumstances = circumstances
        self._timeout_s = timeout_s
        self._tries = tries
        self._home_first = False
        self._turn = asyncio.Lock()
        self._inbox: asyncio.Queue[Any] | None = None
        for message_id in (
            mavlink.MAVLINK_MSG_ID_MISSION_ACK,
            mavlink.MAVLINK_MSG_ID_MISSION_COUNT,
            mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT,
            mavlink.MAVLINK_MSG_ID_MISSION_REQUEST,
            mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
        ):
            session.on(message_id, self._on_message)

    def use_home_first(self, home_first: bool) -> None:
        """Set whether item 0 of a mission is the vehicle's home (ArduPilot)."""
        self._home_first = home_first

    async def upload(self, which: ItemList, items: Sequence[MissionItem]) -> None:
        """Upload a whole mission list, and read it back.

        Raises MissionError, with the last STATUSTEXTs, when it is refused or comes back different.
        """
        sent = list(items)
        doubt: MissionError | None = None
        async with self._turn:
            home = which is ItemList.MISSION and self._home_first and bool(items)
            try:
                await self._send_list(which, [_HOME, *sent] if home else sent)
            except UnsureUploadError as error:
                doubt = error
        difference = _difference(sent, await self.download(which))
        if difference:
            raise doubt or self._error(which, difference)

    async def download(self, which: ItemList) -> tuple[MissionItem, ...]:
        """Return a whole mission list. Raises MissionError."""
        async with self._turn, self._transfer():
            items = await self._read_list(which)
        return items[1:] if which is ItemList.MISSION and self._home_first else items

    async def clear(self, which: ItemList) -> None:
        """Clear a mission list. Raises MissionError."""
        async with self._turn:
            message = self._message(mavlink.MAVLink_mission_clear_all_message, mission_type=which)

            def is_ack(answer: Any) -> bool:
                return bool(answer.get_type() == "MISSION_ACK")

            async with self._transfer():
                # PX4 says nothing to this while it is busy with a transfer.
                answer = await self._exchange(which, message, is_ack, again=self._end_transfers)
                await self._check(which, answer)

    @asynccontextmanager
    async def _transfer(self) -> AsyncIterator[None]:
        """Listen for answers; the vehicle's side of a transfer that does not end is ended."""
        self._inbox = asyncio.Queue()
        try:
            yield
        except BaseException:
            self._end_transfers()
            raise
        finally:
            self._inbox = None

    def _end_transfers(self) -> None:
        """Have the vehicle end what it sends or takes: PX4 refuses all else for 5 s otherwise."""
        for which in ItemList if self._session.target is not None else ():
            cancelled = mavlink.MAV_MISSION_OPERATION_CANCELLED
            kind = mavlink.MAVLink_mission_ack_message
            self._session.send(self._message(kind, type=cancelled, mission_type=which))

    async def _send_list(self, which: ItemList, items: list[MissionItem]) -> None:
        async with self._transfer():
            await self._give_items(which, items)

    async def _give_items(self, which: ItemList, items: list[MissionItem]) -> None:
        last = self._message(
            mavlink.MAVLink_mission_count_message, count=len(items), mission_type=which
        )
        reached = early = repeats = refused = 0
        while True:
            try:
                answer = await self._exchange(which, last, lambda _: True)
                if answer.get_type() == "MISSION_ACK":
                    # An acknowledgement of an earlier operation may still be in flight.
                    if answer.type == _ACCEPTED and reached < len(items):
                        early += 1
                        if early < self._tries:
                            continue
                        what = f"it was accepted after {reached} of {len(items)} items"
                        raise self._error(which, what)
                    if answer.type == _BUSY and reached == 0 and refused < self._tries:
                        # A transfer whose end was lost: PX4 is busy with it.
                        refused += 1
                        self._end_transfers()
                        await asyncio.sleep(self._timeout_s)
                        continue
                    await self._check(which, answer)
                    return
                repeats += 1
                if repeats > _MOST_REPEATS:
                    what = f"{answer.get_type()} comes again and again"
                    raise self._error(which, f"{what}, after {reached} of {len(items)} items")
            except MissionError as error:
                if reached < len(items):
                    raise
                # The final MISSION_ACK comes once: when it is lost, the autopilot is silent or
                # refuses the last item, which is sent again.
                raise UnsureUploadError(str(error)) from error
            if "REQUEST" in answer.get_type() and answer.seq < len(items):
                repeats = repeats if answer.seq < reached else 0
                reached = max(reached, answer.seq + 1)
                last = self._item(which, answer.seq, items[answer.seq])

    async def _read_list(self, which: ItemList) -> tuple[MissionItem, ...]:
        question = self._message(mavlink.MAVLink_mission_request_list_message, mission_type=which)
        answer = await self._exchange(
            which, question, lambda each: each.get_type() == "MISSION_COUNT"
        )
        items: list[MissionItem] = []
        for number in range(answer.count):
            question = self._message(
                mavlink.MAVLink_mission_request_int_message, seq=number, mission_type=which
            )

            def is_it(each: Any, number: int = number) -> bool:
                return bool(each.get_type() == "MISSION_ITEM_INT" and each.seq == number)

            items.append(MissionItem.of(await self._exchange(which, question, is_it)))
        done = self._message(
            mavlink.MAVLink_mission_ack_message, type=_ACCEPTED, mission_type=which
        )
        self._session.send(done)
        return tuple(items)

    async def _exchange(
        self,
        which: ItemList,
        message: Any,
        fits: Callable[[Any], bool],
        again: Callable[[], None] = lambda: None,
    ) -> Any:
        """Send a mission message until a fitting reply of this list arrives.

        again: called before each repetition.
        """
        if self._inbox is None:
            raise RuntimeError("no operation has opened the inbox")
        loop = asyncio.get_running_loop()
        for attempt in range(self._tries):
            if attempt:
                again()
            self._session.send(message)
            deadline_s = loop.time() + self._timeout_s
            try:
                async with asyncio.timeout_at(deadline_s):
                    while True:
                        answer = await self._inbox.get()
                        if answer.mission_type == which and fits(answer):
                            return answer
                        if answer.get_type() == "MISSION_ACK":
                            await self._check(which, answer)
            except TimeoutError:
                continue
        raise self._error(which, f"no answer to {message.get_type()}, sent {self._tries} times")

    async def _check(self, which: ItemList, ack: Any) -> None:
        if ack.mission_type == which and ack.type != _ACCEPTED:
            await asyncio.sleep(STATUSTEXT_WAIT_S)
            name = enum_name("MAV_MISSION_RESULT", ack.type)
            error = self._error(which, f"it was refused with {name}")
            if ack.type == mavlink.MAV_MISSION_UNSUPPORTED:
                raise UnsupportedListError(str(error))
            raise error

    def _error(self, which: ItemList, what: str) -> MissionError:
        where = f"{self._session.link.name}: {which.name.lower()}"
        return MissionError(f"{where}: {what}{self._circumstances()}")

    def _message(self, kind: Any, **fields: Any) -> Any:
        target = self._session.target
        if target is None:
            raise MissionError(f"{self._session.link.name}: no vehicle is identified yet")
        return kind(target_system=target.system, target_component=target.component, **fields)

    def _item(self, which: ItemList, number: int, item: MissionItem) -> Any:
        first, second, third, fourth = item.params
        return self._message(
            mavlink.MAVLink_mission_item_int_message,
            seq=number,
            frame=item.frame,
            command=item.command,
            current=0,
            autocontinue=int(item.autocontinue),
            param1=first,
            param2=second,
            param3=third,
            param4=fourth,
            x=item.x,
            y=item.y,
            z=item.z,
            mission_type=which,
        )

    def _on_message(self, message: Any, _t_s: float) -> None:
        if self._inbox is not None and message.target_system in {0, self._session.own.system}:
            self._inbox.put_nowait(message)


_HOME = MissionItem(command=mavlink.MAV_CMD_NAV_WAYPOINT, frame=mavlink.MAV_FRAME_GLOBAL)


def _difference(sent: Sequence[MissionItem], back: Sequence[MissionItem]) -> str:
    """Return in words how a mission list that came back differs; empty when equal."""
    if len(back) != len(sent):
        return f"{len(sent)} items were sent, and the vehicle returns {len(back)}"
    for number, (mine, its) in enumerate(zip(sent, back, strict=True)):
        if not mine.agrees(its):
            return f"item {number} came back as {its}, but {mine} was sent"
    return ""


def _near(mine: float, its: float) -> bool:
    """Return whether two parameters of a mission item are equal within tolerance, or NaN."""
    # NaN means "not given", and comes back as itself or as 0.
    if mine != mine:  # noqa: PLR0124 - a test for NaN
        return its != its or its == 0.0  # noqa: PLR0124 - as above
    return abs(mine - its) <= _PARAM_TOLERANCE * max(1.0, abs(mine))
