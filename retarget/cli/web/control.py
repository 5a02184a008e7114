"""The page of `web://` in a run: its address, and the requests of people on it."""

import io
import json
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf
from typing import Any

from retarget.cli.application import log
from retarget.cli.controls import GRIPS, ControlRequest
from retarget.cli.stick import STAND, Shares
from retarget.errors import ConfigError, install_step
from retarget.live.address import WEB_PORT, StreamAddress
from retarget.types import News, Notify
from retarget.web.feed import MOST_MESSAGES, Settings, ViewFeed
from retarget.web.link import GO_ON, GRIP, HEALTH, NOTE, PAUSE, RELEASE, STICK, PoseReceiver, open_web
from retarget.web.runtime import runtime_folder

HELD_S = 0.3
"""Time, s, after which a dead-man control or pad without a message counts as let go: three messages."""
MOST_HEALTH = 600
"""Health messages of pages that are kept: ten minutes."""
PAUSED = "paused on the page: the robot holds until it goes on there"
PAGE = "page"
"""`--dead-man` or `--stick` on the page."""
LABEL = "H on the page, a finger on its pad, or the grip of a controller"
"""Name of the dead-man control, for the operator."""
PADS = "the pads on the page of those who look after the robot, while a finger or the mouse holds one"


class PageControl:
    """Control and stick of the page. STOP comes by the feed. health: messages of the pages of performers."""

    def __init__(self, feed: ViewFeed, notify: Notify) -> None:
        self._feed, self._notify = feed, notify
        self._words: deque[str] = deque(maxlen=MOST_MESSAGES)
        self._gripped = dict[str, float]()  # [s] of the last message of each dead-man control
        self._held: bool | None = None  # None: no dead-man control is in use
        self._stick, self._steered = STAND, -inf  # of the pads, and its time [s]
        self.health: deque[dict[str, Any]] = deque(maxlen=MOST_HEALTH)

    def poll(self, now: float) -> Iterator[tuple[ControlRequest, str]]:
        """Yield the requests of pages; see `Control.poll`."""
        self.listen()
        while self._words:
            word = self._words.popleft()
            if word == PAUSE:
                yield ControlRequest.PAGE_HOLD, PAUSED
            elif word == GO_ON:
                yield ControlRequest.PAGE_GO_ON, "no pause of the page any more"
            elif word.startswith(GRIP):
                self._gripped[word.removeprefix(GRIP)] = now
            elif word.startswith(RELEASE):
                self._gripped[word.removeprefix(RELEASE)] = -inf
            elif word.startswith(STICK):
                forward, left, turn = map(float, word.removeprefix(STICK).split())
                self._stick, self._steered = (forward, left, turn), now
        held = all(now - at <= HELD_S for at in self._gripped.values())  # a page that is gone has let go
        if self._gripped and held is not self._held:
            self._held = held
            yield GRIPS[held]

    def shares(self, now: float) -> Shares:
        """The shares of the pads; see `Stick.shares`."""
        return self._stick if now - self._steered <= HELD_S else STAND

    def listen(self) -> None:
        """Pass on notes, and keep health and requests."""
        for word in self._feed.messages():
            if word.startswith(NOTE):
                self._notify(News(word.removeprefix(NOTE)))
            elif word.startswith(HEALTH):
                self.health.append(json.loads(word.removeprefix(HEALTH)))
            else:
                self._words.append(word)

    def times(self) -> dict[str, list[float]]:
        """Latencies, s, of poses before their arrival, by stage of `LiveReport.latency_ms`."""
        stages = {"page": ("send_ms", 1e-3), "network": ("rtt_ms", 0.5e-3)}
        return {
            stage: [by * said[key] for said in self.health if isinstance(said.get(key), int | float)]
            for stage, (key, by) in stages.items()
        }

    def look(self) -> None:
        """Call `listen` while nothing moves. Raises KeyboardInterrupt once STOP was pressed."""
        self.listen()
        if self._feed.stop_requested():
            raise KeyboardInterrupt


@contextmanager
def opened_web(
    address: StreamAddress,
    robot: str,
    *,
    listen: bool = False,
    dead_man: bool = False,
    stick: bool = False,
    notify: Notify,
) -> Iterator[tuple[ViewFeed, PoseReceiver]]:
    """Open the page of a run and the receiver of its poses, and notify the operator of its address, with a code for a
    phone. Raises ConfigError if it cannot be served."""
    try:
        import segno
        import trustme  # noqa: F401  (the page's process needs these two)
        import websockets  # noqa: F401
    except ImportError as error:
        raise ConfigError(
            "web:// needs websockets, segno and trustme",
            found=str(error),
            next_step=install_step("websockets", "segno", "trustme"),
        ) from error
    settings = Settings(listen=listen, port=address.port, robot=robot, dead_man=dead_man, stick=stick)
    with open_web(settings) as (feed, receiver):
        where, _, fingerprint = feed.address.partition(" ")
        for line in directions(where, fingerprint):
            notify(line)
        if listen and sys.stderr.isatty():  # a phone reads it
            code = io.StringIO()
            segno.make(where, error="l").terminal(code, compact=True)
            log(code.getvalue())
        yield feed, receiver


def directions(address: str, fingerprint: str) -> Iterator[str]:
    """Yield directions to the page. fingerprint: of its certificate, "" without one."""
    yield f"Open {address}"
    if fingerprint:
        yield (
            "the browser warns of the certificate, which this run has made for itself: go on if its SHA-256 "
            f"fingerprint is {fingerprint}"
        )
        yield (
            "a headset on a cable needs no certificate: run without --listen, then "
            f"`adb reverse tcp:{WEB_PORT} tcp:{WEB_PORT}`, and open the address that is printed then in its browser"
        )
    if runtime_folder() is None:
        yield "a camera needs `retarget web install` once; a headset does not"
