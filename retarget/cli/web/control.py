"""The page of `web://` in a run of the command line: its address, and what people ask for on it."""

import io
import json
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf
from typing import Any

from retarget.cli.application import log
from retarget.cli.controls import GRIPS, Asked
from retarget.cli.stick import STAND, Shares
from retarget.errors import ConfigError, install_step
from retarget.live.address import WEB_PORT, StreamAddress
from retarget.types import News, Notify
from retarget.web.feed import MOST_WORDS, Settings, ViewFeed
from retarget.web.link import GO_ON, GRIP, HEALTH, NOTE, PAUSE, RELEASE, STICK, PoseReceiver, open_web
from retarget.web.runtime import runtime_folder

HELD_S = 0.3
"""A dead-man control or a pad that is not confirmed for so long counts as let go, s: three messages of its page."""
MOST_HEALTH = 600
"""What a page said of itself that is kept: ten minutes, once a second."""
PAUSED = "paused on the page: the robot holds until it goes on there"
PAGE = "page"
"""`--dead-man` or `--stick` on the page."""
LABEL = "H on the page, a finger on its pad, or the grip of a controller"
"""What the operator has to hold."""
PADS = "the pads on the page of those who look after the robot, while a finger or the mouse holds one"


class PageControl:
    """What is asked for on the page: pause and go on, its dead-man control and its stick. STOP comes by the feed
    itself. notify: receives what the page's process says. health: what performers' pages said of themselves."""

    def __init__(self, feed: ViewFeed, notify: Notify) -> None:
        self._feed, self._notify = feed, notify
        self._asked: deque[str] = deque(maxlen=MOST_WORDS)
        self._gripped = dict[str, float]()  # [s] when each dead-man control in use was last confirmed
        self._held: bool | None = None  # None: none is in use
        self._stick, self._steered = STAND, -inf  # what the pads asked for last, and when [s]
        self.health: deque[dict[str, Any]] = deque(maxlen=MOST_HEALTH)

    def poll(self, now: float) -> Iterator[tuple[Asked, str]]:
        """Return what was asked for, as `Control.poll` says."""
        self.listen()
        while self._asked:
            word = self._asked.popleft()
            if word == PAUSE:
                yield Asked.PAGE_HOLD, PAUSED
            elif word == GO_ON:
                yield Asked.PAGE_GO_ON, "no pause of the page any more"
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
        """What the pads ask for, as `Stick.shares` says."""
        return self._stick if now - self._steered <= HELD_S else STAND

    def listen(self) -> None:
        """Report what the page's process says, and keep what is asked for."""
        for word in self._feed.words():
            if word.startswith(NOTE):
                self._notify(News(word.removeprefix(NOTE)))
            elif word.startswith(HEALTH):
                self.health.append(json.loads(word.removeprefix(HEALTH)))
            else:
                self._asked.append(word)

    def times(self) -> dict[str, list[float]]:
        """How long poses were under way before they arrived, s, by stage as `LiveReport.latency_ms` has them."""
        stages = {"page": ("send_ms", 1e-3), "network": ("rtt_ms", 0.5e-3)}
        return {
            stage: [by * said[key] for said in self.health if isinstance(said.get(key), int | float)]
            for stage, (key, by) in stages.items()
        }

    def look(self) -> None:
        """`listen`, while nothing moves. Raises KeyboardInterrupt once STOP was pressed."""
        self.listen()
        if self._feed.stop_asked():
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
    """The page of a run, and the poses that it sends. Says where it is, with a code for a phone to read. Raises
    ConfigError where it cannot be served."""
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
    """How to open the page. fingerprint: of its certificate, "" without one."""
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
