"""The console's web server: the page, its WebSocket, and commands by POST.

Every request has its Host checked; requests that read or change anything also their Origin and
session, before anything else of them is used.

Checks a fence from the page before it is sent to the runs, which decide on it; pure.
"""

import time
from collections.abc import Awaitable, Callable, Iterable, Iterator
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any

from aiohttp import web

from wil_campaign.campaigns.setup.vehicle_fences import changed_fences
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.plugins.console.console_access import AccessError, ConsoleAccess, ConsoleSession
from wil_campaign.plugins.console.console_address import RequestRules
from wil_campaign.plugins.console.console_hub import ConsoleHub
from wil_campaign.plugins.console.feed.feed_messages import RunView
from wil_campaign.plugins.console.page_client import MAX_MESSAGE_BYTES, PageClient
from wil_campaign.plugins.console.page_commands import (
    MAX_BODY_BYTES,
    CommandSender,
    PageCommand,
    parse_request_body,
)
from wil_campaign.plugins.console.playback import Playback
from wil_campaign.safety.fence.areas import FenceError
from wil_campaign.safety.fence.fence_files import parse_fence_file
from wil_campaign.safety.fence.fence_values import fence_of_plain
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.operator.operator_lines import (
    RefusedLineError,
    checked_operator_name,
)
from wil_campaign.safety.guard.operator.rate_limit import RateLimit
from wil_campaign.worlds.geodesy import LocalFrame

_NOWHERE = LocalFrame(0.0, 0.0, 0.0)
"""The page draws in metres, so the origin on Earth does not matter."""


def check_operator_fence(text: str, views: Iterable[RunView]) -> None:
    """Raise AccessError for an invalid fence, or one with a flying vehicle outside.

    Whether a vehicle can stop inside, and whether its autopilot accepts it, the run checks.
    """
    flying = [view for view in views if view.stage != "end"]
    try:
        present = [_fences(view) for view in flying]
        document = parse_fence_file(text.encode(), name="geofence")
        changed = changed_fences(document, _NOWHERE, present[-1] if present else {})
    except BadInput as error:
        why = "; ".join(problem.message for problem in error.problems)
        raise AccessError(f"geofence: {why}") from error
    except (FenceError, ValueError, KeyError, TypeError) as error:
        raise AccessError(f"geofence: {error}") from error
    fences: dict[str, Fence] = {str(name): fence for name, fence in changed.items()}
    for view in flying:
        for vehicle in view.vehicles:
            fence, position_ned_m = fences.get(vehicle.name), vehicle.position_ned_m
            if fence is None or position_ned_m is None:
                continue
            if (margin_m := fence.margin_m(position_ned_m)) < 0.0:
                raise AccessError(f"geofence: {vehicle.name} would be {-margin_m:.2f} m outside")


def _fences(view: RunView) -> dict[str, Fence]:
    return {name: fence_of_plain(plain) for name, plain in view.fences.items()}


POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
_KINDS = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
_MOST_RECORDED_HZ = 5
_MOST_PAGES = 32
_HEARTBEAT_S = 5.0
NAME_PREFIX = "console:"
"""Prefix of an operator's name in every record."""

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class ConsoleServer:
    """The web application of a console. rules: for the address at which it listens.

    playback: of a finished run; None for runs in flight.
    """

    def __init__(
        self,
        *,
        access: ConsoleAccess,
        rules: RequestRules,
        hub: ConsoleHub,
        sender: CommandSender,
        cookie: str,
        time: Callable[[], float],
        playback: Playback | None = None,
    ) -> None:
        self.playback = playback
        self._access = access
        self._rules = rules
        self._hub = hub
        self._sender = sender
        self._cookie = cookie
        self._time = time
        self._refusals = RateLimit(most=_MOST_RECORDED_HZ)
        self._pages: set[web.WebSocketResponse] = set()
        self._files = dict(_page_files(files("wil_campaign.plugins.console") / "page"))

    def close(self) -> None:
        """Stop sending commands, after those in progress."""
        self._sender.close()

    def application(self) -> web.Application:
        """Return the application to serve."""
        application = web.Application(
            middlewares=[self._middleware()], client_max_size=MAX_BODY_BYTES
        )
        application.add_routes(
            [
                web.get("/", self._index),
                web.get("/page/{name:.+}", self._file),
                web.get("/live", self._live),
                web.post("/session", self._begin_session),
                web.post("/command", self._command),
                web.post("/control", self._control),
                web.post("/playback", self._change_playback),
                web.post("/invite", self._invite),
            ]
        )
        application.on_shutdown.append(self._close_pages)
        return application

    def _middleware(self) -> Any:
        @web.middleware
        async def guarded(request: web.Request, handler: Handler) -> web.StreamResponse:
            needs_origin = request.method != "GET" or request.path == "/live"
            try:
                self._rules.check(request.headers, needs_origin=needs_origin)
                response = await handler(request)
            except AccessError as error:
                self._record(f"{request.method[:16]} {request.path[:80]}: {error}")
                response = web.json_response({"ok": False, "text": str(error)}, status=403)
            except web.HTTPException as error:
                self._record(f"{request.method[:16]} {request.path[:80]}: {error.reason}")
                response = web.json_response(
                    {"ok": False, "text": error.reason}, status=error.status
                )
            if not response.prepared:
                response.headers.update(_HEADERS)
            return response

        return guarded

    def _record(self, text: str) -> None:
        """Record a refused request, rate limited so that a flood does not fill the disk."""
        if not self._refusals.is_exceeded(self._time()):
            self._sender.refuse(text)

    def _session(self, request: web.Request) -> ConsoleSession:
        return self._access.session(request.cookies.get(self._cookie, ""))

    async def _index(self, request: web.Request) -> web.StreamResponse:
        del request
        return self._resource("index.html")

    async def _file(self, request: web.Request) -> web.StreamResponse:
        return self._resource(request.match_info["name"])

    def _resource(self, name: str) -> web.StreamResponse:
        if name not in self._files:
            raise web.HTTPNotFound
        kind = _KINDS[name.rpartition(".")[2]]
        return web.Response(body=self._files[name], content_type=kind, charset="utf-8")

    async def _begin_session(self, request: web.Request) -> web.StreamResponse:
        document = await _json_of(request)
        token, name = document.get("token"), document.get("name", "")
        if not isinstance(token, str):
            raise AccessError("a session needs the token of a link")
        session = self._access.begin(token, _checked_name(name))
        response = web.json_response({"ok": True, "text": f"session of role {session.role}"})
        response.set_cookie(
            self._cookie,
            session.key,
            httponly=True,
            samesite="Strict",
            secure=self._rules.scheme == "https",
        )
        return response

    async def _command(self, request: web.Request) -> web.StreamResponse:
        session = self._session(request)
        try:
            command = PageCommand.parse(await _json_of(request), time.monotonic())
        except RefusedLineError as error:
            raise AccessError(str(error)) from error
        self._access.require_command(session, command.kind)
        if command.kind == "geofence":
            check_operator_fence(command.document, self._hub.views())
        outcome = await self._sender.send(command, f"{NAME_PREFIX}{session.name}")
        about = {"command": command.kind, "who": session.name, "is_obeyed": outcome.is_obeyed}
        missing = [
            {"name": place.name, "folder": str(place.folder)} for place in outcome.unconfirmed
        ]
        self._hub.show_command(
            {**about, "ok": outcome.ok, "texts": outcome.texts, "unconfirmed": missing}
        )
        return web.json_response(
            {
                "ok": outcome.ok,
                "is_obeyed": outcome.is_obeyed,
                "text": "; ".join(outcome.texts),
            }
        )

    async def _control(self, request: web.Request) -> web.StreamResponse:
        session = self._session(request)
        self._access.take_control(session)
        self._hub.show_people()
        return web.json_response({"ok": True, "text": f"{session.name} has control"})

    async def _change_playback(self, request: web.Request) -> web.StreamResponse:
        session = self._session(request)
        if self.playback is None:
            raise AccessError("this console shows runs in flight: nothing is played back")
        if session.role != "operator":
            raise AccessError("only an operator can pause a run or change its speed or time")
        self.playback.change(await _json_of(request))
        return web.json_response({"ok": True, "text": ""})

    async def _invite(self, request: web.Request) -> web.StreamResponse:
        session = self._session(request)
        role = (await _json_of(request)).get("role")
        if session.role != "operator" or role not in ("operator", "viewer"):
            raise AccessError("only an operator can create a link, of role operator or viewer")
        token = self._access.invite(role)
        link = f"{self._rules.scheme}://{request.headers['Host']}/#{token}"
        return web.json_response({"ok": True, "text": link})

    async def _live(self, request: web.Request) -> web.StreamResponse:
        session = self._session(request)
        if len(self._pages) >= _MOST_PAGES:
            raise AccessError(f"{_MOST_PAGES} pages are open already")
        socket = web.WebSocketResponse(
            max_msg_size=MAX_MESSAGE_BYTES, heartbeat=_HEARTBEAT_S, compress=False
        )
        await socket.prepare(request)
        page = PageClient(socket, session)
        self._pages.add(socket)
        self._hub.join(page)
        try:
            await page.serve()
        finally:
            self._pages.discard(socket)
            self._hub.leave(page)
        return socket

    async def _close_pages(self, _: web.Application) -> None:
        for socket in tuple(self._pages):
            await socket.close(code=1001, message=b"the console has ended")


def _page_files(folder: Traversable, beneath: str = "") -> Iterator[tuple[str, bytes]]:
    for traversable in folder.iterdir():
        if traversable.is_dir():
            yield from _page_files(traversable, f"{beneath}{traversable.name}/")
        elif traversable.name.rpartition(".")[2] in _KINDS:
            yield f"{beneath}{traversable.name}", traversable.read_bytes()


async def _json_of(request: web.Request) -> dict[str, Any]:
    if request.content_type != "application/json":
        raise AccessError("the content type of a request must be application/json")
    document = parse_request_body(await request.read())
    if not isinstance(document, dict):
        raise AccessError("a request must be a JSON object")
    return document


def _checked_name(name: Any) -> str:
    """Return an operator's name that is safe for records. Raises AccessError."""
    try:
        return checked_operator_name(f"{NAME_PREFIX}{name}").removeprefix(NAME_PREFIX) or "operator"
    except RefusedLineError as error:
        raise AccessError(str(error)) from error
