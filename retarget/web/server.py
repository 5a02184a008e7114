"""The page of a run, of `--view` and of `web://`, served by a process of its own: its files, and a WebSocket to each
browser.

`python -m retarget.web.server FD SETTINGS`: FD is the process's end of the pair of sockets that
`retarget.web.feed.ViewFeed` has the other end of, SETTINGS is JSON of `retarget.web.feed.Settings`.

The page sends JSON: `hello` with an input and a name; poses, as docs/live.md has them, or 33 landmarks of a camera,
`{"axes": "camera", "time": 12.345, "frame": 741, "size": [640, 480], "landmarks": [[u, v, x, y, z, visibility], ...]}`.
u and v are shares of the picture's width and height; x, y and z are metres with the hips as origin, x to the right of
the picture, y down and z away from the camera. It may also send `stop`, `pause`, `go on`, `health`, and ten times a
second `held` (true or false) and `stick` (`forward`, `left` and `turn`, each -1 to 1). The server sends `welcome` or
`refused`, `note`, `paused` (why, "" where it is not), `scene` (triangles of each link), and `state` 25 times a second,
with the poses of all links behind it, see `packed_state`.

A browser is a performer, whose poses go on to the run byte for byte, or looks on. Any of them may stop the robot, that
of `web://` pause it, and that of a run with `--stick page` let it walk. Nothing is served without the key in its
address, and one performer at a time is heard.
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
"""The player of `retarget/pictures`, which draws the page of a report, too."""
FILES = {"": HERE / "page" / "index.html"} | {name: HERE.parent / "pictures" / name for name in DRAWING}
"""What is served beside the folder of the page and that of the runtime, by its place under the key."""

MOST_HOLDS = 64
"""Pages that may use a dead-man control in one run."""
MOST_CLIENTS = 8
"""Browsers at a time: a performer, and who looks after the robot."""
MOST_PER_S, BURST = 150.0, 300.0
"""Messages a second that a browser may send on average (a headset at 90 Hz, and what a page says of itself), and how
many at once (a page that was busy for two seconds)."""
HELLO_S = 2.0
"""A browser that does not say for so long who it is, s, is sent away: the page says so at once."""
HEARTBEAT_S = 0.1
"""Time between two messages to the run that a STOP is asked for, s."""
SLOW_BYTES = 1 << 18
"""Bytes that wait for a browser before rows are left out for it: some seconds of them."""
MOST_SAID = 200
"""Characters of a sentence of a page that are shown."""
REPORTED_AGAIN_S, MOST_REPORTED = 10.0, 50
"""The same sentence goes to the terminal again after so long, s; and so many are known apart."""
STEERS_S = 0.3
"""A page whose pad is held and that has not said so for so long, s, steers no more."""
LOST_S = 0.5
"""A performer whose page sends no frame for so long, s, or leaves, pauses the robot, which has held since 0.2 s. It
goes on when asked to."""
ASKED, LOST = "it was asked for on a page", "the performer was lost: page, link or camera"
"""Why the robot is paused."""
OUT_OF_REACH_M, SETTLED_S, SETTLED_M = 0.03, 0.5, 0.02
"""A landmark of the robot that follows is out of reach if it is farther than the first of these from where it is asked,
m, though for so long, s, it has not moved by more than the last, m: before that the robot may only be late."""
LAST_SHOWN_S = 1.5
"""So long the page stays when the run has ended, with the reason."""


@dataclass(eq=False)
class Client:
    """A browser. identity: what its page calls itself. performs: "camera", "headset", or "" for who looks on; sent:
    when its last frame came. room: messages that it may send at once, as of `since`."""

    socket: ServerConnection
    room: float = BURST
    since: float = 0.0
    identity: str = ""
    performs: str = ""
    sent: float = np.inf


class _Ended(Exception):
    """A client that is sent away; its text says why."""


OTHER_PAGE = "the page says something else than its server understands: load it anew"


@dataclass(eq=False)
class PageServer:
    """Passes poses to the run, and what the run says to every browser. feed, poses: sockets to the run."""

    settings: Settings
    feed: socket.socket
    poses: socket.socket | None
    clock: Clock
    clients: dict[Client, None] = field(default_factory=dict)
    said: dict[str, str | bytes] = field(default_factory=dict)
    """The last message of each kind to all browsers: a new one gets them, too."""
    ended: asyncio.Event = field(default_factory=asyncio.Event)
    _known: dict[str, int] = field(default_factory=dict)
    """Numbers of performers, by what their pages call themselves."""
    _cast: Cast | None = None
    _last: RunTable | None = None
    _latest: tuple[str, str] | None = None
    """Identity and input of the performer who came last."""
    _measured: tuple[str, str] | None = None
    """The same of who the robot follows."""
    _holds: dict[str, int] = field(default_factory=dict)
    """Numbers of the pages that have used a dead-man control, by their identity."""
    _steers: tuple[Client | None, float] = None, -np.inf
    """The browser that steers, and until when [s] it does unless it says so again."""
    _stop: bool = False
    _reported: dict[str, float] = field(default_factory=dict)
    """When a sentence went to the terminal."""
    _round_trip_ms: float = 0.0
    _moved: deque[tuple[float, FloatArray]] = field(default_factory=deque)
    """Times, s, and landmarks of the robot in the rows of the last SETTLED_S."""

    # Browsers.

    async def talk(self, connection: ServerConnection) -> None:
        """Serve one browser until it leaves, or is sent away with a sentence."""
        client = Client(connection, since=self.clock.now())
        try:
            await self._welcome(client)
            async for message in connection:
                self._take(client, message)
        except _Ended as why:
            self.notify(f"a page was sent away: {why}")
            with suppress(ConnectionClosed):
                await connection.send(json.dumps({"hear": "refused", "why": str(why)}))
        except ConnectionClosed:
            pass
        finally:
            if client.identity in self._holds:
                self._word(f"{RELEASE}{self._holds[client.identity]}")
            if self.clients.pop(client, 0) is None and client.performs:
                self.notify("the performer's page is gone")
                self._lost(client)

    async def _welcome(self, client: Client) -> None:
        """Hear who a browser is, and answer with what goes on. Raises _Ended for one that may not take part."""
        try:
            hello = _parsed(await asyncio.wait_for(client.socket.recv(), HELLO_S))
        except TimeoutError:
            raise _Ended(f"the page has not said for {HELLO_S:g} s what it is: load it anew") from None
        client.identity, given = str(hello.get("id", ""))[:64], str(hello.get("input"))
        inputs = ("camera", "headset", "watch") if self.settings.performs else ("watch",)
        if hello.get("say") != "hello" or given not in inputs or not client.identity:
            raise _Ended(OTHER_PAGE)
        if len(self.clients) >= MOST_CLIENTS:
            raise _Ended(f"more than {MOST_CLIENTS} pages are open: close one")
        if given != "watch":
            self._admit(client.identity, given)
            client.performs = given
            self.notify(f"a performer is here, with a {given}")
        settings = self.settings
        welcome = {
            "hear": "welcome",
            "robot": robot_words(settings.robot),
            "performs": settings.performs,
            "runtime": runtime_folder() is not None,
            "dead_man": settings.dead_man,
            "stick": settings.stick,
        }
        self.clients[client] = None
        for text in (json.dumps(welcome), *self.said.values()):
            await client.socket.send(text)

    def _admit(self, identity: str, given: str) -> None:
        """Raise _Ended while another performer is here, and for another one, or another input, than was measured. A
        page of the same identity, loaded anew or doubled, takes the place of the older one."""
        if any(one.performs and one.identity != identity for one in self.clients):
            raise _Ended("another performer is here: one at a time. This page can look after the robot instead")
        if self._measured not in (None, (identity, given)):
            raise _Ended("the robot follows who was measured, by the same input: end the run, and start it anew")
        for older in [one for one in self.clients if one.performs]:
            older.performs = ""
            _send(older, json.dumps({"hear": "refused", "why": "this page was opened once more, and performs there"}))
        self._latest = identity, given
        self._known.setdefault(identity, len(self._known) + 1)

    def _lost(self, client: Client) -> None:
        """A performer is gone, or sends nothing any more: the robot holds already, and goes on when asked to. In a
        headset, it goes on when the grip is taken anew."""
        client.sent = np.inf
        if self._measured is not None and not (client.performs == "headset" and client.identity in self._holds):
            self._pause(LOST)

    def _take(self, client: Client, message: str | bytes) -> None:
        """One message of a browser. Raises _Ended for one that floods, or says what no page of ours says."""
        now = self.clock.now()
        client.room = min(client.room + (now - client.since) * MOST_PER_S, BURST) - 1.0
        client.since = now
        if client.room < 0.0:
            raise _Ended(f"the page sends more than {MOST_PER_S:g} messages a second")
        if isinstance(message, str) and not message.startswith('{"say"'):
            self._forward(client, message.encode(), now)
            return
        said = _parsed(message)
        say, settings = str(said["say"]), self.settings
        may = settings.stick if say == "stick" else settings.performs or say in LOOKING_ON
        act = _SAYINGS.get(say) if may else None
        if act is None:
            raise _Ended(OTHER_PAGE)
        act(self, client, said)

    def _forward(self, client: Client, frame: bytes, now: float) -> None:
        """Poses to the run; where it takes none, it waits for newer ones."""
        if client.performs and self.poses is not None and len(frame) <= MAX_DATAGRAM:
            client.sent = now
            with suppress(OSError):
                self.poses.send(HEADER.pack(now, self._known[client.identity]) + frame)

    def stop(self, client: Client, said: dict[str, Any]) -> None:
        """STOP was pressed: it is sent to the run again and again, and every page hears that it is."""
        self._stop = True
        self._send_stop()
        self._send_all("stop", {})

    def _send_stop(self) -> None:
        if self._stop:
            with suppress(OSError):
                self.feed.send(STOP)

    def pause(self, client: Client, said: dict[str, Any]) -> None:
        """A page pauses the robot, or lets it go on."""
        self._pause(ASKED if said["say"] == "pause" else "")

    def _pause(self, why: str) -> None:
        self._word(PAUSE if why else GO_ON)
        self._send_all("paused", {"why": why})

    def hold(self, client: Client, said: dict[str, Any]) -> None:
        """A dead-man control is held, or let go: from now on the robot needs it, and every other one that is in use."""
        if client.identity not in self._holds and len(self._holds) >= MOST_HOLDS:
            raise _Ended(f"more than {MOST_HOLDS} pages have used a dead-man control: end the run, and start it anew")
        number = self._holds.setdefault(client.identity, len(self._holds))
        self._word(f"{GRIP if said.get('held') is True else RELEASE}{number}")

    def steer(self, client: Client, said: dict[str, Any]) -> None:
        """A pad is held, or let go: how fast the robot is to walk. One page at a time steers, until it lets go."""
        shares = [said.get(name) for name in ("forward", "left", "turn")]
        if not all(type(one) in (int, float) and abs(one) <= 1.0 for one in shares):  # type: ignore[arg-type]
            raise _Ended(OTHER_PAGE)
        steers, until = self._steers
        if steers is not client and self.clock.now() < until:
            return
        self._steers = client, self.clock.now() + STEERS_S if any(shares) else -np.inf
        self._word(STICK + " ".join(f"{one:.3f}" for one in shares))

    def pong(self, client: Client, said: dict[str, Any]) -> None:
        """Answer at once: the page measures the way there and back."""
        _send(client, json.dumps({"hear": "pong", "t": said.get("t")}))

    def health(self, client: Client, said: dict[str, Any]) -> None:
        """A new trouble of a page goes into the terminal, and what a performer's page says of itself to the run."""
        if (trouble := _plain(said.get("trouble"))) and isinstance(trouble, str):
            self.notify(f"the page: {trouble}")
        if not client.performs:
            return
        health = {key: value for key in HEALTH_KEYS if (value := _plain(said.get(key))) is not None}
        self._word(HEALTH + json.dumps(health))
        self._round_trip_ms = float(health.get("rtt_ms") or 0.0)

    async def beat(self) -> None:
        """Repeat that a STOP is asked for, and look for a performer who is lost, until the run has ended."""
        while not self.ended.is_set():
            self._send_stop()
            for client in self.clients:
                if client.performs and self.clock.now() - client.sent > LOST_S:
                    self._lost(client)
            await asyncio.sleep(HEARTBEAT_S)

    def notify(self, text: str) -> None:
        """Say a sentence in the terminal of the run, the same one seldom."""
        now = self.clock.now()
        if now - self._reported.get(text, -np.inf) > REPORTED_AGAIN_S:
            self._reported = {**self._reported, text: now} if len(self._reported) < MOST_REPORTED else {text: now}
            self._word(f"{NOTE}{text}")

    def _word(self, word: str) -> None:
        with suppress(OSError):
            self.feed.send(word.encode())

    # The run.

    def hear_run(self) -> None:
        """Pass on what the run has said since the last call."""
        while True:
            try:
                message = self.feed.recv(BUFFER_BYTES)
            except BlockingIOError:
                return
            except ConnectionResetError:  # the run has ended without reading all; what it said comes next (unix(7))
                continue
            if not message:
                asyncio.get_running_loop().remove_reader(self.feed)
                self.ended.set()
                return
            self._pass_on(unpacked(message))

    def _pass_on(self, said: PageSetup | RunTable | Note | str) -> None:
        if isinstance(said, str):
            self._send_all("state", {"state": said})
        elif isinstance(said, Note):
            self._send_all("note", {"text": said.note})
        elif isinstance(said, PageSetup):
            self._begin(said)
        elif self.clients:
            self._show(said)
        self._last = said if isinstance(said, RunTable) else self._last

    def _begin(self, setup: PageSetup) -> None:
        """Load what is seen, whole before the run goes on: this work would slow it."""
        try:
            self._cast = cast_of(setup)
            self._measured = self._latest
        except RetargetError as error:
            self.feed.send(REFUSED + str(error).encode()[: LONGEST_ANSWER - len(REFUSED)])
            return
        self._send_all("scene", self._cast.as_json())
        self.feed.send(READY)

    def _show(self, row: RunTable) -> None:
        """A tick: its state in words, with the tracks of what is drawn."""
        cast = self._cast
        assert cast is not None, "a run says first who is seen"
        tracks = live_tracks(cast, row)
        state = {"hear": "state", **self._state(cast, row), "tracks": {name: one.size for name, one in tracks.items()}}
        self._send_to_all("state", packed_state(state, tracks.values()))

    def _state(self, cast: Cast, row: RunTable) -> dict[str, Any]:
        """What the page says of a tick."""
        sensors = dict(zip(cast.sensors, row.sensors, strict=True)) if "sensors" in row else {}
        known = {name: bool(np.isfinite(at).all()) for name, at in sensors.items()}
        state = {"time": round(float(row.time), 3), "state": row.doing, "why": row.reason, "sensors": known}
        if "latency" in row:
            state["latency_ms"] = {"page to goal": round(0.5 * self._round_trip_ms + 1e3 * float(row.latency), 1)}
        if "imu_valid" in row and np.isfinite(row.imu_orientation).all():
            up = rotate(conjugate(row.imu_orientation), [0.0, 0.0, 1.0])
            right, forward = np.degrees(np.arctan2([up[1], -up[0]], up[2]))
            ways = ("back" if forward < 0.0 else "forward", "left" if right < 0.0 else "right")
            tilted = f"tilted {abs(forward):.0f}° {ways[0]}, {abs(right):.0f}° {ways[1]}"
            state["imu"] = tilted if row.imu_valid else "no IMU"
        return state | {"clipped": [*self._clipped(cast, row)]}

    def _clipped(self, cast: Cast, row: RunTable) -> Iterator[str]:
        """Landmarks that the robot does not reach, in words."""
        if "landmarks_asked" not in row or cast.profile is None or row.doing != STATE_WORDS[RunState.FOLLOW]:
            self._moved.clear()
            return
        now, reached = (
            float(row.time),
            cast.profile.points(row.q[None], cast.profile.landmark_frames(cast.landmarks))[0],
        )
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
        self._send_to_all(kind, json.dumps({"hear": kind, **content}))

    def _send_to_all(self, kind: str, message: str | bytes) -> None:
        self.said[kind] = message
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
"""What a page says of itself that the run hears."""
LARGEST = 1e6
"""Largest number of it."""


def _plain(value: object) -> float | str | bool | None:
    """A number in range, a short printable text or a truth value; None for anything else."""
    if isinstance(value, bool):
        return value
    if isinstance(value, str):
        return value[:MOST_SAID] if value.isprintable() else None
    return float(value) if isinstance(value, int | float) and 0.0 <= value <= LARGEST else None


_SAYINGS: dict[str, Callable[[PageServer, Client, dict[str, Any]], None]] = {
    "stop": PageServer.stop,
    "pause": PageServer.pause,
    "go on": PageServer.pause,
    "held": PageServer.hold,
    "stick": PageServer.steer,
    "ping": PageServer.pong,
    "health": PageServer.health,
}
"""What a page may say beside poses."""
LOOKING_ON = ("stop", "ping", "health")
"""The part of it that a page may say on which people only look on."""


def served_file(place: str) -> Path | None:
    """The file at a place under the key; None where there is none. Names are plain: no folder can be left."""
    if place in FILES:
        return FILES[place]
    folder, *inner = place.split("/")
    if not inner or not all(name.replace("_", "").replace("-", "").replace(".", "").isalnum() for name in inner):
        return None
    root = {"page": HERE / "page", "runtime": runtime_folder()}.get(folder)
    path = None if root is None else root.joinpath(*inner)
    return path if path is not None and ".." not in inner and path.is_file() else None


def _parsed(message: str | bytes) -> dict[str, Any]:
    """What a page says. Raises _Ended for anything else than an object that says something."""
    try:
        said = json.loads(message)
    except (ValueError, RecursionError):
        said = None
    if not isinstance(said, dict) or "say" not in said:
        raise _Ended(OTHER_PAGE)
    return said


def _send(client: Client, message: str | bytes) -> None:
    """Send without waiting; a browser that does not keep up gets the next one."""
    if client.socket.transport.get_write_buffer_size() < SLOW_BYTES:
        broadcast([client.socket], message)


def packed_state(state: dict[str, Any], tracks: Iterable[FloatArray]) -> bytes:
    """A message with numbers: how many bytes of JSON, a multiple of four (32 bits), the JSON, and the tracks that it
    names, 32-bit floats, all little-endian; NaN: not known."""
    text = json.dumps(state).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<I", len(text)) + text + b"".join(one.astype("<f4").tobytes() for one in tracks)


def robot_words(robot: str) -> str:
    """The name of a robot of which the name or the file of its profile is given."""
    try:
        return read_profile(robot).name
    except RetargetError:  # which the run says, or it is a human
        return robot


def cast_of(setup: PageSetup) -> Cast:
    """Robot and performer of a run. Raises RetargetError for a robot or scene that cannot be read."""
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
"""Of a page on which people look on: the run comes first, but a press of STOP must not wait behind every process."""


async def _serve(settings: Settings, feed: socket.socket, poses: socket.socket | None) -> None:
    """Serve until the run ends. Raises ConfigError where no port is free."""
    server = PageServer(settings, feed, poses, MonotonicClock())
    pages = Pages(served_file, listen=settings.listen, talk=server.talk, notify=server.notify)
    listener = await pages.open(settings.port)
    for link in filter(None, (feed, poses)):
        link.setblocking(False)
    feed.send(READY + f"{pages.access.address} {pages.fingerprint}".strip().encode())
    asyncio.get_running_loop().add_reader(feed, server.hear_run)
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
