"""The process that serves the page of a run (`--view`, `web://`): its files, and a WebSocket to each browser.

Usage: `python -m retarget.web.server FD SETTINGS`. FD is the other end of the sockets of `retarget.web.feed.ViewFeed`,
SETTINGS is JSON of `retarget.web.feed.Settings`.

Messages are JSON objects with a `type`. The page sends `hello` (`input` and `id`), `stop`, `pause`, `go on`, `health`,
`ping`, and ten times a second `held` and `stick` (`forward`, `left` and `turn`, each -1 to 1). The server sends
`welcome` or `refused`, `note`, `paused` (`why`, or ""), `scene`, `stop`, `pong`, and 25 times a second `state`, see
`packed_state`. Frames have no type, and go to the run unchanged: poses as in docs/live.md, or landmarks of a camera,
`{"axes": "camera", "time": 12.345, "frame": 741, "size": [640, 480], "landmarks": [[u, v, x, y, z, visibility], ...]}`.
u and v are shares of the picture's width and height. x, y and z are metres from the hips: to the right of the picture,
down, and away from the camera.

Any page may stop the robot. A page of `web://` may pause it, and one of `--stick page` makes it walk.
"""

import asyncio
import json
import os
import signal
import socket
import struct
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from websockets.asyncio.server import ServerConnection, broadcast
from websockets.exceptions import ConnectionClosed

from hardware.clock import Clock, MonotonicClock
from hardware.errors import RetargetError
from retarget.model.body import body_from_file
from retarget.model.body_file import compile_body_text
from retarget.model.meshes import solid_body
from retarget.model.robot import load_robot
from retarget.model.scene_shapes import scene_shapes
from retarget.model.scene_state import obstacle_meshes
from retarget.rotations import conjugate, rotate
from retarget.run.table import RunTable
from retarget.schema.profile import read_profile
from retarget.schema.scene import load_scene
from retarget.sources.streams.stream_frame import MAX_DATAGRAM
from retarget.types import FloatArray, RunState
from retarget.web.feed import (
    BUFFER_BYTES,
    LONGEST_ANSWER,
    READY,
    REFUSED,
    STATE_WORDS,
    STOP,
    Note,
    PageSetup,
    Settings,
    unpacked,
)
from retarget.web.link import GO_ON, GRIP, HEADER, HEALTH, NOTE, PAUSE, RELEASE, STICK
from retarget.web.runtime import runtime_folder
from retarget.web.serving import Pages
from retarget.web.shown import Cast, live_tracks

HERE = Path(__file__).parent
DRAWING = ("bodies.js", "figure.js", "plot.js", "base.css")
"""Files of `retarget/pictures` that a report uses, too."""
FILES = {"": HERE / "page" / "index.html"} | {name: HERE.parent / "pictures" / name for name in DRAWING}
"""Files outside of the folders of page and runtime, by their place under the key."""

MOST_HOLDS = 64
"""Pages that may use a dead-man control in one run."""
MOST_CLIENTS = 8
"""Browsers at a time."""
MOST_PER_S, BURST = 150.0, 300.0
"""Messages of a browser: mean rate, 1/s (a headset at 90 Hz, and `health`) and at once (two seconds)."""
HELLO_S = 2.0
"""Longest wait for `hello`, s."""
HEARTBEAT_S = 0.1
"""Time between repeated STOP requests to the run, s."""
SLOW_BYTES = 1 << 18
"""Backlog of a browser that gets no more messages, bytes: some seconds of rows."""
MOST_SHOWN = 200
"""Longest text of a page that is shown, characters."""
REPORTED_AGAIN_S, MOST_REPORTED = 10.0, 50
"""Time before the terminal repeats a sentence, s, and most known sentences."""
STEERS_S = 0.3
"""Time after which a `stick` expires, s."""
LOST_S = 0.5
"""Silence of a performer that pauses the robot, s. It holds after 0.2 s."""
PAGE_PAUSE, LOST = "it was asked for on a page", "the performer was lost: page, link or camera"
"""Reasons of a pause."""
OUT_OF_REACH_M, SETTLED_S, SETTLED_M = 0.03, 0.5, 0.02
"""A landmark is out of reach if it is farther than the first, m, from its target and moved by less than the third, m,
over the second, s. A robot that moves more may only be late."""
LAST_SHOWN_S = 1.5
"""Time for which the page shows how the run ended, s."""


@dataclass(eq=False)
class Client:
    """A browser. identity: drawn by its page. performs: "camera", "headset" or "". sent: time of its last frame, s.
    room: messages that it may send at once, as of `since`, s."""

    socket: ServerConnection
    room: float = BURST
    since: float = 0.0
    identity: str = ""
    performs: str = ""
    sent: float = np.inf


class _ClientRefused(Exception):
    """A client is disconnected for the reason in the text."""


OTHER_PAGE = "the page sends a message that its server does not know: load it anew"


@dataclass(eq=False)
class PageServer:
    """Relays poses to the run, and its messages to every browser. feed, poses: sockets to the run."""

    settings: Settings
    feed: socket.socket
    poses: socket.socket | None
    clock: Clock
    clients: dict[Client, None] = field(default_factory=dict)
    newest: dict[str, str | bytes] = field(default_factory=dict)
    """The last message of each type, for new browsers."""
    ended: asyncio.Event = field(default_factory=asyncio.Event)
    _known: dict[str, int] = field(default_factory=dict)
    """Identity -> number of the performer."""
    _cast: Cast | None = None
    _last: RunTable | None = None
    _latest: tuple[str, str] | None = None
    """Identity and input of the newest performer."""
    _measured: tuple[str, str] | None = None
    """Identity and input of the measured performer."""
    _holds: dict[str, int] = field(default_factory=dict)
    """Identity -> number of its dead-man control."""
    _steers: tuple[Client | None, float] = None, -np.inf
    """The browser that steers, and until when, s."""
    _stop: bool = False
    _reported: dict[str, float] = field(default_factory=dict)
    """Sentence -> time in the terminal, s."""
    _round_trip_ms: float = 0.0
    _moved: deque[tuple[float, FloatArray]] = field(default_factory=deque)
    """Times, s, and landmarks of the last SETTLED_S."""

    # Browsers.

    async def talk(self, connection: ServerConnection) -> None:
        """Serve one browser until it leaves or is refused."""
        client = Client(connection, since=self.clock.now())
        try:
            await self._welcome(client)
            async for message in connection:
                self._take(client, message)
        except _ClientRefused as why:
            self.notify(f"a page was sent away: {why}")
            with suppress(ConnectionClosed):
                await connection.send(json.dumps({"type": "refused", "why": str(why)}))
        except ConnectionClosed:
            pass
        finally:
            if client.identity in self._holds:
                self._send_run(f"{RELEASE}{self._holds[client.identity]}")
            if self.clients.pop(client, 0) is None and client.performs:
                self.notify("the performer's page is gone")
                self._lost(client)

    async def _welcome(self, client: Client) -> None:
        try:
            hello = _parsed(await asyncio.wait_for(client.socket.recv(), HELLO_S))
        except TimeoutError:
            raise _ClientRefused(f"no hello came from the page for {HELLO_S:g} s: load it anew") from None
        client.identity, given = str(hello.get("id", ""))[:64], str(hello.get("input"))
        inputs = ("camera", "headset", "watch") if self.settings.performs else ("watch",)
        if hello["type"] != "hello" or given not in inputs or not client.identity:
            raise _ClientRefused(OTHER_PAGE)
        if len(self.clients) >= MOST_CLIENTS:
            raise _ClientRefused(f"more than {MOST_CLIENTS} pages are open: close one")
        if given != "watch":
            self._admit(client.identity, given)
            client.performs = given
            self.notify(f"a performer is here, with a {given}")
        settings = self.settings
        welcome = {
            "type": "welcome",
            "robot": robot_name(settings.robot),
            "performs": settings.performs,
            "runtime": runtime_folder() is not None,
            "dead_man": settings.dead_man,
            "stick": settings.stick,
        }
        self.clients[client] = None
        for text in (json.dumps(welcome), *self.newest.values()):
            await client.socket.send(text)

    def _admit(self, identity: str, given: str) -> None:
        """Raise _ClientRefused if there is, or was measured, another performer or input. A page of the same identity
        replaces the older one."""
        if any(one.performs and one.identity != identity for one in self.clients):
            raise _ClientRefused("another performer is here: one at a time. This page can look after the robot instead")
        if self._measured not in (None, (identity, given)):
            raise _ClientRefused(
                "the robot follows who was measured, by the same input: end the run, and start it anew"
            )
        for older in [one for one in self.clients if one.performs]:
            older.performs = ""
            _send(older, json.dumps({"type": "refused", "why": "this page was opened once more, and performs there"}))
        self._latest = identity, given
        self._known.setdefault(identity, len(self._known) + 1)

    def _lost(self, client: Client) -> None:
        """Pause the robot. A headset with a grip needs no pause: the robot holds until it is gripped again."""
        client.sent = np.inf
        if self._measured is not None and not (client.performs == "headset" and client.identity in self._holds):
            self._pause(LOST)

    def _take(self, client: Client, message: str | bytes) -> None:
        now = self.clock.now()
        client.room = min(client.room + (now - client.since) * MOST_PER_S, BURST) - 1.0
        client.since = now
        if client.room < 0.0:
            raise _ClientRefused(f"the page sends more than {MOST_PER_S:g} messages a second")
        if isinstance(message, str) and not message.startswith('{"type"'):
            frame = message.encode()
            if client.performs and self.poses is not None and len(frame) <= MAX_DATAGRAM:
                client.sent = now
                with suppress(OSError):  # a run that takes no frame now gets a newer one
                    self.poses.send(HEADER.pack(now, self._known[client.identity]) + frame)
            return
        content = _parsed(message)
        kind, settings = str(content["type"]), self.settings
        allowed = settings.stick if kind == "stick" else settings.performs or kind in SPECTATOR_TYPES
        handle = _HANDLERS.get(kind) if allowed else None
        if handle is None:
            raise _ClientRefused(OTHER_PAGE)
        handle(self, client, content)

    def stop(self, client: Client, content: dict[str, Any]) -> None:
        """Send STOP to the run until it ends, and confirm it to every page."""
        self._stop = True
        self._send_stop()
        self._send_all("stop", {})

    def _send_stop(self) -> None:
        if self._stop:
            with suppress(OSError):
                self.feed.send(STOP)

    def pause(self, client: Client, content: dict[str, Any]) -> None:
        """Pause the robot, or let it go on."""
        self._pause(PAGE_PAUSE if content["type"] == "pause" else "")

    def _pause(self, why: str) -> None:
        self._send_run(PAUSE if why else GO_ON)
        self._send_all("paused", {"why": why})

    def hold(self, client: Client, content: dict[str, Any]) -> None:
        """Relay the state of a dead-man control. The robot moves only while all used ones are held."""
        if client.identity not in self._holds and len(self._holds) >= MOST_HOLDS:
            raise _ClientRefused(
                f"more than {MOST_HOLDS} pages have used a dead-man control: end the run, and start it anew"
            )
        number = self._holds.setdefault(client.identity, len(self._holds))
        self._send_run(f"{GRIP if content.get('held') is True else RELEASE}{number}")

    def steer(self, client: Client, content: dict[str, Any]) -> None:
        """Relay the walking speed of a pad. One page at a time steers, until it lets go."""
        shares = [content.get(name) for name in ("forward", "left", "turn")]
        if not all(type(one) in (int, float) and abs(one) <= 1.0 for one in shares):  # type: ignore[arg-type]
            raise _ClientRefused(OTHER_PAGE)
        steers, until = self._steers
        if steers is not client and self.clock.now() < until:
            return
        self._steers = client, self.clock.now() + STEERS_S if any(shares) else -np.inf
        self._send_run(STICK + " ".join(f"{one:.3f}" for one in shares))

    def pong(self, client: Client, content: dict[str, Any]) -> None:
        """Answer at once, so that the page can measure the round trip."""
        _send(client, json.dumps({"type": "pong", "t": content.get("t")}))

    def health(self, client: Client, content: dict[str, Any]) -> None:
        """Show a new trouble in the terminal, and relay the health of a performer's page."""
        if (trouble := _plain(content.get("trouble"))) and isinstance(trouble, str):
            self.notify(f"the page: {trouble}")
        if not client.performs:
            return
        health = {key: value for key in HEALTH_KEYS if (value := _plain(content.get(key))) is not None}
        self._send_run(HEALTH + json.dumps(health))
        self._round_trip_ms = float(health.get("rtt_ms") or 0.0)

    async def beat(self) -> None:
        """Repeat a STOP, and detect a lost performer, until the run has ended."""
        while not self.ended.is_set():
            self._send_stop()
            for client in self.clients:
                if client.performs and self.clock.now() - client.sent > LOST_S:
                    self._lost(client)
            await asyncio.sleep(HEARTBEAT_S)

    def notify(self, text: str) -> None:
        """Show a sentence in the terminal, the same one at most every REPORTED_AGAIN_S."""
        now = self.clock.now()
        if now - self._reported.get(text, -np.inf) > REPORTED_AGAIN_S:
            self._reported = {**self._reported, text: now} if len(self._reported) < MOST_REPORTED else {text: now}
            self._send_run(f"{NOTE}{text}")

    def _send_run(self, message: str) -> None:
        with suppress(OSError):
            self.feed.send(message.encode())

    # The run.

    def receive_run(self) -> None:
        """Handle all messages of the run since the last call."""
        while True:
            try:
                message = self.feed.recv(BUFFER_BYTES)
            except BlockingIOError:
                return
            except ConnectionResetError:  # the run ended without reading all; its last messages come next (unix(7))
                continue
            if not message:
                asyncio.get_running_loop().remove_reader(self.feed)
                self.ended.set()
                return
            self._pass_on(unpacked(message))

    def _pass_on(self, message: PageSetup | RunTable | Note | str) -> None:
        if isinstance(message, str):
            self._send_all("state", {"state": message})
        elif isinstance(message, Note):
            self._send_all("note", {"text": message.note})
        elif isinstance(message, PageSetup):
            self._begin(message)
        elif self.clients:
            self._show(message)
        self._last = message if isinstance(message, RunTable) else self._last

    def _begin(self, setup: PageSetup) -> None:
        """Load the bodies before the run goes on, since this work would slow it."""
        try:
            self._cast = cast_of(setup)
            self._measured = self._latest
        except RetargetError as error:
            self.feed.send(REFUSED + str(error).encode()[: LONGEST_ANSWER - len(REFUSED)])
            return
        self._send_all("scene", self._cast.as_json())
        self.feed.send(READY)

    def _show(self, row: RunTable) -> None:
        cast = self._cast
        assert cast is not None, "a run sends its PageSetup first"
        tracks = live_tracks(cast, row)
        state = {"type": "state", **self._state(cast, row), "tracks": {name: one.size for name, one in tracks.items()}}
        self._send_to_all("state", packed_state(state, tracks.values()))

    def _state(self, cast: Cast, row: RunTable) -> dict[str, Any]:
        sensors = dict(zip(cast.sensors, row.sensors, strict=True)) if "sensors" in row else {}
        known = {name: bool(np.isfinite(at).all()) for name, at in sensors.items()}
        state = {"time": round(float(row.time), 3), "state": row.doing, "why": row.reason, "sensors": known}
        if "latency" in row:
            state["latency_ms"] = {"page to goal": round(0.5 * self._round_trip_ms + 1e3 * float(row.latency), 1)}
        if "imu_valid" in row and np.isfinite(row.imu_orientation).all():
            up = rotate(conjugate(row.imu_orientation), [0.0, 0.0, 1.0])
            right, forward = np.degrees(np.arctan2([up[1], -up[0]], up[2]))
            directions = ("back" if forward < 0.0 else "forward", "left" if right < 0.0 else "right")
            tilted = f"tilted {abs(forward):.0f}° {directions[0]}, {abs(right):.0f}° {directions[1]}"
            state["imu"] = tilted if row.imu_valid else "no IMU"
        return state | {"clipped": [*self._clipped(cast, row)]}

    def _clipped(self, cast: Cast, row: RunTable) -> Iterator[str]:
        if "landmarks_asked" not in row or cast.profile is None or row.doing != STATE_WORDS[RunState.FOLLOW]:
            self._moved.clear()
            return
        now = float(row.time)
        reached = cast.profile.points(row.q[None], cast.profile.landmark_frames(cast.landmarks))[0]
        while len(self._moved) > 1 and self._moved[1][0] <= now - SETTLED_S:
            self._moved.popleft()
        self._moved.append((now, reached))
        if self._moved[0][0] > now - SETTLED_S:
            return
        moved = np.max([np.linalg.norm(reached - before, axis=1) for _, before in self._moved], axis=0)
        distances = np.linalg.norm(reached - row.landmarks_asked, axis=1)
        for name, off, still in zip(cast.landmarks, distances, moved <= SETTLED_M, strict=True):
            if still and off > OUT_OF_REACH_M:
                side = {"l_": "left ", "r_": "right "}.get(name[:2], "")
                yield f"{side}{(name[2:] if side else name).replace('_', ' ')} {100 * off:.0f} cm out of reach"

    def _send_all(self, kind: str, content: dict[str, Any]) -> None:
        self._send_to_all(kind, json.dumps({"type": kind, **content}))

    def _send_to_all(self, kind: str, message: str | bytes) -> None:
        self.newest[kind] = message
        for client in self.clients:
            _send(client, message)

    def close(self) -> None:
        """Show how the run ended, with its reason."""
        why = "" if self._last is None else self._last.reason
        self._send_all("state", {"state": "ended", "why": why})


HEALTH_KEYS = (
    *("fps", "infer_ms", "rtt_ms", "send_ms"),
    *("camera", "trouble", "permission", "agent", "secure", "wasm", "hidden"),
)
"""Fields of `health` that the run gets."""
LARGEST = 1e6
"""Largest number in them."""


def _plain(value: object) -> float | str | bool | None:
    """A number in range, a short printable text or a bool, else None."""
    if isinstance(value, bool):
        return value
    if isinstance(value, str):
        return value[:MOST_SHOWN] if value.isprintable() else None
    return float(value) if isinstance(value, int | float) and 0.0 <= value <= LARGEST else None


_HANDLERS: dict[str, Callable[[PageServer, Client, dict[str, Any]], None]] = {
    "stop": PageServer.stop,
    "pause": PageServer.pause,
    "go on": PageServer.pause,
    "held": PageServer.hold,
    "stick": PageServer.steer,
    "ping": PageServer.pong,
    "health": PageServer.health,
}
"""Handlers of messages, by type."""
SPECTATOR_TYPES = ("stop", "ping", "health")
"""Messages that are allowed where no page may perform."""


def served_file(place: str) -> Path | None:
    """The file at a place under the key; None if there is none. Only plain names are valid, so no folder can be
    left."""
    if place in FILES:
        return FILES[place]
    folder, *inner = place.split("/")
    if not inner or not all(name.replace("_", "").replace("-", "").replace(".", "").isalnum() for name in inner):
        return None
    root = {"page": HERE / "page", "runtime": runtime_folder()}.get(folder)
    path = None if root is None else root.joinpath(*inner)
    return path if path is not None and ".." not in inner and path.is_file() else None


def _parsed(message: str | bytes) -> dict[str, Any]:
    """The content of a message. Raises _ClientRefused for anything but an object with a type."""
    try:
        content = json.loads(message)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or "type" not in content:
        raise _ClientRefused(OTHER_PAGE)
    return content


def _send(client: Client, message: str | bytes) -> None:
    """Send without waiting. A browser that does not keep up misses messages."""
    if client.socket.transport.get_write_buffer_size() < SLOW_BYTES:
        broadcast([client.socket], message)


def packed_state(state: dict[str, Any], tracks: Iterable[FloatArray]) -> bytes:
    """Encode a message, little-endian: the size of the JSON, 32 bits, a multiple of four; the JSON; the tracks that it
    names, 32-bit floats. NaN is unknown."""
    text = json.dumps(state).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<I", len(text)) + text + b"".join(one.astype("<f4").tobytes() for one in tracks)


def robot_name(robot: str) -> str:
    """The name of a robot, given by name or by the file of its profile."""
    try:
        return read_profile(robot).name
    except RetargetError:  # the run reports it, or it is a human
        return robot


def cast_of(setup: PageSetup) -> Cast:
    """Load robot and performer of a run. Raises RetargetError."""
    robot = None if setup.robot is None else load_robot(setup.robot, root=setup.root)
    human = compile_body_text(setup.human_mjcf, source="human of the run", root="free", own=True)
    return Cast(
        human=solid_body(body_from_file(human)),
        robot=None if robot is None else robot.solid,
        profile=robot,
        joints=() if robot is None else robot.joint_map.joints,
        landmarks=setup.landmarks,
        sensors=setup.sensors,
        obstacles=obstacle_meshes(scene_shapes(load_scene(setup.scene))) if setup.scene else (),
        servos_measure=setup.servos_measure,
    )


NICENESS = 5
"""Niceness of a page without performer: the run comes first, but STOP must not wait."""


async def _serve(settings: Settings, feed: socket.socket, poses: socket.socket | None) -> None:
    server = PageServer(settings, feed, poses, MonotonicClock())
    pages = Pages(served_file, listen=settings.listen, talk=server.talk, notify=server.notify)
    listener = await pages.open(settings.port)
    for link in filter(None, (feed, poses)):
        link.setblocking(False)
    feed.send(READY + f"{pages.access.address} {pages.fingerprint}".strip().encode())
    asyncio.get_running_loop().add_reader(feed, server.receive_run)
    beating = asyncio.create_task(server.beat())
    await server.ended.wait()
    server.close()
    await asyncio.sleep(LAST_SHOWN_S)
    listener.close()
    await beating


def main(arguments: list[str]) -> int:
    """Serve until the run ends."""
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN)
    settings = Settings(**json.loads(arguments[1]))
    if not settings.performs:  # it stays in the session of the run, in which alone its niceness counts (autogroups)
        os.nice(NICENESS)
    feed = socket.socket(fileno=int(arguments[0]))
    poses = socket.socket(fileno=settings.poses) if settings.poses >= 0 else None
    try:
        asyncio.run(_serve(settings, feed, poses))
    except RetargetError as error:
        feed.send(REFUSED + str(error).encode()[: LONGEST_ANSWER - len(REFUSED)])
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
