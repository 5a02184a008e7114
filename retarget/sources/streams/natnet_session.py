"""The session with a Motive server: what to send and when. No socket and no clock.

The owner of the sockets sends each datagram of `poll` to `COMMAND_PORT` of the server, gives every datagram that the
server sends to `receive` and to a `NatnetDecoder`, and calls `poll` at least ten times a second. `names_missing`
returns the decoder's property of that name.

* Unicast: one socket on any free port, for everything: the server sends its frames to the port that connected.
* Multicast: that socket for questions and answers, and a second one, bound to the group's port with address reuse,
  which joins the group on the interface that faces the server (not simply the default one).
"""

from collections.abc import Callable
from math import inf

from retarget.sources.streams.natnet_wire import (
    OLDEST,
    FrameFlags,
    MessageId,
    ServerInfo,
    Version,
    connect_message,
    message,
    read_definitions,
    read_flags,
    read_server_info,
    split,
)

NEWEST = Version(4, 255)
"""The last bitstream that is read."""
UNNAMED_S = 5.0
"""Time between two requests for names that the last answer did not have."""
RETRY_S = 1.0
"""Time, s, between requests without answer."""
KEEP_ALIVE_S = 1.0
"""Time, s, between keep-alive messages to a unicast server."""
SILENCE_S = 2.0
"""Time without frames after which the session connects again."""


class NatnetSession:
    """State of one session. `now`: s of one monotonic clock throughout.

    group: address and port of the multicast group that was joined, None in unicast. The server's clock is not asked
    for: a running minimum of arrival minus stamp does as well.

    To read: server (None until it answered); frames (count); started, server_at, frame_at, asked_at (s, None before;
    asked_at: since when definitions are waited for). To set: names_missing, whether frames have ids without a name.
    """

    def __init__(self, *, group: tuple[str, int] | None = None) -> None:
        self.group = group
        self.names_missing: Callable[[], bool] = lambda: False
        self.server: ServerInfo | None = None
        self.frames = 0
        self.started: float | None = None
        self.server_at: float | None = None
        self.frame_at: float | None = None
        self.asked_at: float | None = None
        self._wants_definitions = False
        self._wants_server = True
        self._flagged = (False, False)
        self._sent: dict[str, float] = {}
        """When each kind of message was last sent, s."""

    def silent(self, now: float) -> bool:
        """Return whether no frame came for SILENCE_S, and the server answered at least that long ago."""
        since = max((at for at in (self.server_at, self.frame_at) if at is not None), default=None)
        return since is not None and now - since >= SILENCE_S

    def poll(self, now: float) -> list[bytes]:
        """Return the datagrams to send at `now`, s, all to the command port."""
        if self.started is None:
            self.started = now
        out: list[bytes] = []
        if (self._wants_server or self.silent(now)) and self._due("connect", RETRY_S, now):
            out.append(connect_message())
        if self.server is None:
            return out
        unnamed = self.frames and not self._wants_definitions and self.names_missing()
        if unnamed and self._due("names", UNNAMED_S, now):
            self._wants_definitions = True
        if self._wants_definitions and self._due("definitions", RETRY_S, now):
            self.asked_at = now if self.asked_at is None else self.asked_at
            out.append(message(MessageId.DEFINITIONS_REQUEST))
        if self.group is None and self._due("keep-alive", KEEP_ALIVE_S, now):
            out.append(message(MessageId.KEEP_ALIVE))
        return out

    def _due(self, kind: str, interval: float, now: float) -> bool:
        """Whether a kind of message was not sent for `interval` s; if so, it counts as sent now."""
        due = now - self._sent.get(kind, -inf) >= interval
        if due:
            self._sent[kind] = now
        return due

    def receive(self, now: float, datagram: bytes) -> None:
        """Update the session from a datagram of the server. Never raises; the decoder counts what cannot be read."""
        parts = split(datagram)
        if parts is None:
            return
        kind, payload = parts
        if kind == MessageId.FRAME:
            self._frame(now, payload)
        elif kind == MessageId.SERVER_INFO:
            self._server(now, read_server_info(payload))
        elif kind == MessageId.DEFINITIONS:
            version = self.server.version if self.server else OLDEST
            if read_definitions(payload, version) is not None:
                self._wants_definitions = False
                self.asked_at = None

    def _server(self, now: float, info: ServerInfo | None) -> None:
        if info is None:
            return
        if self.server_at is None:
            self.server_at = now
        self._wants_server = False
        if info != self.server:
            self.server = info
            self._wants_definitions = True

    def _frame(self, now: float, payload: bytes) -> None:
        flags = read_flags(payload)
        if flags is None:
            return
        if self.frames and self.silent(now):
            # Motive was paused or started again, so its ids may have changed meaning.
            self._wants_definitions = True
        self.frames += 1
        self.frame_at = now
        definitions = FrameFlags.DEFINITIONS_CHANGED in flags
        bitstream = FrameFlags.BITSTREAM_CHANGED in flags
        if definitions and not self._flagged[0]:
            self._wants_definitions = True
        if bitstream and not self._flagged[1]:
            self._wants_server = self._wants_definitions = True
        self._flagged = (definitions, bitstream)
