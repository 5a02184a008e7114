"""A stand-in for the server of `web://`: serves the page with the headers of the real one, keeps what the page says,
and says what a test asks for. Nothing of a run is in it."""

import asyncio
import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from retarget.types import FloatArray
from retarget.web.server import packed_state, served_file
from retarget.web.serving import file_response

KEY = "key-of-the-test"
STATE_HZ = 20.0
Message = dict[str, Any]


@dataclass
class Said:
    """A message of the page. at: s of the monotonic clock. connection: counts the connections of the stand-in."""

    at: float
    connection: int
    message: Message


@dataclass
class StandIn:
    """runtime: whether the real body tracker is there. files: what is served instead of files, by path below the
    key. welcome, state, scene: sent to every page; tracks: of the state. refused: inputs that are refused, with the
    reason. said: by all pages. port, host: where it serves."""

    runtime: bool = False
    files: dict[str, bytes] = field(default_factory=dict)
    welcome: Message = field(default_factory=dict)
    state: Message = field(default_factory=lambda: {"state": "waiting"})
    scene: Message | None = None
    tracks: dict[str, FloatArray] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    said: list[Said] = field(default_factory=list)
    port: int = 0
    host: str = "127.0.0.1"
    connections: int = 0
    _live: set[ServerConnection] = field(default_factory=set)
    _loop: asyncio.AbstractEventLoop = field(default_factory=asyncio.new_event_loop)
    _server: Server | None = None

    @property
    def address(self) -> str:
        return f"http://localhost:{self.port}/{KEY}/"

    # For tests, from their own thread.

    @property
    def pages(self) -> int:
        """How many are connected."""
        return len(self._live)

    def say(self, message: Message) -> None:
        """To every page."""
        asyncio.run_coroutine_threadsafe(self._broadcast(message), self._loop).result(5)

    def drop(self) -> None:
        """Lose every connection, as a network does."""
        for connection in list(self._live):
            self._loop.call_soon_threadsafe(connection.transport.abort)

    def messages(self, kind: str, since: float = 0.0) -> list[Said]:
        """What was said: "frame" for poses, else the word of `say`."""
        return [said for said in list(self.said) if said.at >= since and said.message.get("type", "frame") == kind]

    def wait(self, condition: Callable[[], Any], within: float = 10.0) -> Any:
        """The first true value of the condition. Raises AssertionError after `within`, s."""
        end = time.monotonic() + within
        while time.monotonic() < end:
            if found := condition():
                return found
            threading.Event().wait(0.02)
        raise AssertionError(f"not within {within:g} s; newest said: {[said.message for said in self.said[-3:]]}")

    # The server, in its thread.

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        path = request.path.split("?")[0]
        if not path.startswith(f"/{KEY}/"):
            return connection.respond(HTTPStatus.FORBIDDEN, "no key")
        name = path.removeprefix(f"/{KEY}/")
        if name == "ws":
            return None
        if name in self.files:
            return file_response(name, self.files[name])
        place = served_file(name)
        if place is None or (name.startswith("runtime/") and not self.runtime):
            return connection.respond(HTTPStatus.NOT_FOUND, "no such file")
        return file_response(place.name, place.read_bytes())

    async def _serve_page(self, connection: ServerConnection) -> None:
        number = self.connections
        self.connections += 1
        self._live.add(connection)
        with suppress(ConnectionClosed):
            await self._receive(connection, number)
        self._live.discard(connection)

    async def _receive(self, connection: ServerConnection, number: int) -> None:
        news: asyncio.Task[None] | None = None
        try:
            async for text in connection:
                message = json.loads(text)
                self.said.append(Said(time.monotonic(), number, message))
                if message.get("type") == "hello":
                    if why := self.refused.get(message["input"]):
                        await connection.send(json.dumps({"type": "refused", "why": why}))
                        return
                    await self._begin(connection)
                    news = asyncio.create_task(self._send_states(connection))
                elif message.get("type") in ("pause", "go on"):
                    await self._broadcast({"type": "paused", "why": "why not" if message["type"] == "pause" else ""})
                elif message.get("type") == "stop":
                    await connection.send(json.dumps({"type": "stop"}))
                elif message.get("type") == "ping":
                    await connection.send(json.dumps({"type": "pong", "t": message["t"]}))
        finally:
            if news:
                news.cancel()

    async def _begin(self, connection: ServerConnection) -> None:
        known = {"robot": "op3", "performs": True, "dead_man": False, "stick": False}
        runtime = self.runtime or "runtime/vision_bundle.mjs" in self.files
        await connection.send(json.dumps({"type": "welcome", "runtime": runtime} | known | self.welcome))
        if self.scene:
            await connection.send(json.dumps({"type": "scene"} | self.scene))

    async def _send_states(self, connection: ServerConnection) -> None:
        with suppress(ConnectionClosed):
            while True:
                sizes = {name: one.size for name, one in self.tracks.items()}
                state = {"type": "state", "time": time.monotonic(), "tracks": sizes} | self.state
                await connection.send(packed_state(state, self.tracks.values()))
                await asyncio.sleep(1 / STATE_HZ)

    async def _broadcast(self, message: Message) -> None:
        for connection in list(self._live):
            await connection.send(json.dumps(message))

    async def _open(self) -> None:
        self._server = await serve(
            self._serve_page, self.host, self.port, process_request=self._answer, compression=None, max_size=65536
        )
        self.port = next(iter(self._server.sockets)).getsockname()[1]

    async def _close(self) -> None:
        assert self._server is not None
        self._server.close()
        await self._server.wait_closed()


@contextmanager
def running(stand_in: StandIn) -> Iterator[StandIn]:
    """Serve in a thread of its own."""
    loop = stand_in._loop
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    asyncio.run_coroutine_threadsafe(stand_in._open(), loop).result(5)
    try:
        yield stand_in
    finally:
        asyncio.run_coroutine_threadsafe(stand_in._close(), loop).result(5)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(5)
