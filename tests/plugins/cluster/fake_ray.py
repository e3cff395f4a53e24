"""A cluster without Ray: actors are objects of this process, their calls run in threads."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeoutError
from typing import Any


class _RayError(Exception):
    pass


class _GetTimeoutError(_RayError):
    pass


class _ActorDiedError(_RayError):
    pass


class _TaskError(_RayError):
    def __init__(self, cause: BaseException) -> None:
        super().__init__(str(cause))
        self.cause = cause


class FakeExceptions:
    RayError = _RayError
    GetTimeoutError = _GetTimeoutError


class FakeReference:
    def __init__(self, running: "Future[Any]") -> None:
        self._running = running

    def future(self) -> "Future[Any]":
        return self._running


class FakeMethod:
    def __init__(self, actor: "FakeActor", name: str) -> None:
        self._actor = actor
        self._name = name

    def remote(self, *values: object) -> FakeReference:
        return FakeReference(self._actor.submit(self._name, values))


class FakeActor:
    def __init__(self, made: Callable[[], Any]) -> None:
        self._threads = ThreadPoolExecutor(8)
        self.made = made()
        self._waiting: list[Future[Any]] = []
        self.is_dead = False

    def __getattr__(self, name: str) -> FakeMethod:
        return FakeMethod(self, name)

    def submit(self, name: str, values: tuple[object, ...]) -> "Future[Any]":
        given: Future[Any] = Future()
        if self.is_dead:
            given.set_exception(_ActorDiedError("the actor is dead"))
            return given
        self._waiting.append(given)

        def call() -> None:
            try:
                result = getattr(self.made, name)(*values)
            except Exception as error:  # noqa: BLE001  # as Ray does
                if not given.done():
                    given.set_exception(_TaskError(error))
            else:
                if not given.done():
                    given.set_result(result)

        self._threads.submit(call)
        return given

    def die(self) -> None:
        """End as a worker of Ray does: its child is killed, and who waits is told."""
        if self.is_dead:
            return
        self.is_dead = True
        self.made.die()
        for given in self._waiting:
            if not given.done():
                given.set_exception(_ActorDiedError("the actor has died"))
        self._threads.shutdown(wait=False)


class PendingActor(FakeActor):
    """An actor for which the cluster has no place: its calls have no result until it is killed."""

    def __init__(self) -> None:
        self._waiting = []
        self.is_dead = False

    def submit(self, name: str, values: tuple[object, ...]) -> "Future[Any]":
        self._waiting.append(Future())
        return self._waiting[-1]

    def die(self) -> None:
        self.is_dead = True
        for given in self._waiting:
            if not given.done():
                given.set_exception(_ActorDiedError("the actor has died"))


class FakeRay:
    """What of the module ray the engine uses. agent: makes what stands for an agent.

    cpus: of the one node; an actor more than that finds no place.
    """

    exceptions = FakeExceptions

    def __init__(self, agent: Callable[[], Any], cpus: int = 64) -> None:
        self.cpus = cpus
        self._agent = agent
        self.actors: list[FakeActor] = []
        self.options: dict[str, object] = {}

    def remote(self, **options: object) -> Callable[[object], Any]:
        self.options = options
        ray = self

        class Remote:
            @staticmethod
            def remote() -> FakeActor:
                there = sum(not actor.is_dead for actor in ray.actors)
                ray.actors.append(FakeActor(ray._agent) if there < ray.cpus else PendingActor())
                return ray.actors[-1]

        return lambda _: Remote

    def get(self, references: list[FakeReference], timeout: float) -> list[Any]:
        try:
            return [reference.future().result(timeout) for reference in references]
        except FutureTimeoutError as error:
            raise _GetTimeoutError from error

    def nodes(self) -> list[dict[str, Any]]:
        return [
            {"Alive": True, "NodeManagerHostname": "here", "Resources": {"CPU": float(self.cpus)}}
        ]

    def kill(self, actor: FakeActor, *, no_restart: bool) -> None:
        assert no_restart
        actor.die()
