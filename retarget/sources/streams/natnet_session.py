"""The session with a Motive server: the messages to send, and when. It has no socket and no clock.

The owner of the sockets calls `poll` at least ten times a second, sends its datagrams to `COMMAND_PORT`, and gives
every datagram of the server to `receive`. In unicast one socket on any port does it all. In multicast a second one,
bound to the group's port with address reuse, joins the group on the interface that faces the server.
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
"""Last bitstream that is read."""
UNNAMED_S = 5.0
"""Time, s, between requests for names that the last answer lacked."""
RETRY_S = 1.0
"""Time, s, between unanswered requests."""
KEEP_ALIVE_S = 1.0
"""Time, s, between keep-alive messages to a unicast server."""
SILENCE_S = 2.0
"""Time, s, without frames before the session connects again."""


class NatnetSession:
    """State of one session. `now` is always s of one monotonic clock.

    group: address and port of the multicast group, None in unicast. names_missing: the decoder's property of that name.
    started, server_at, frame_at: s, None before. definitions_requested_at: s, None unless definitions are outstanding.
    """

    def __init__(self, *, group: tuple[str, int] | None = None) -> None:
        self.group = group
        self.names_missing: Callable[[], bool] = lambda: False
        self.server: ServerInfo | None = None
        self.frames = 0
        self.started: float | None = None
        self.server_at: float | None = None
        self.frame_at: float | None = None
        self.definitions_requested_at: float | None = None
        self._needs_definitions = False
        self._needs_server = True
        self._flagged = (False, False)
        self._sent: dict[str, float] = {}
        """When each kind of message was last sent, s."""

    def silent(self, now: float) -> bool:
        """True if no frame came for SILENCE_S since the last one or the server's answer."""
        since = max((at for at in (self.server_at, self.frame_at) if at is not None), default=None)
        return since is not None and now - since >= SILENCE_S

    def poll(self, now: float) -> list[bytes]:
        """The datagrams to send at `now`, all to the command port."""
        if self.started is None:
            self.started = now
        out: list[bytes] = []
        if (self._needs_server or self.silent(now)) and self._due("connect", RETRY_S, now):
            out.append(connect_message())
        if self.server is None:
            return out
        unnamed = self.frames and not self._needs_definitions and self.names_missing()
        if unnamed and self._due("names", UNNAMED_S, now):
            self._needs_definitions = True
        if self._needs_definitions and self._due("definitions", RETRY_S, now):
            if self.definitions_requested_at is None:
                self.definitions_requested_at = now
            out.append(message(MessageId.DEFINITIONS_REQUEST))
        if self.group is None and self._due("keep-alive", KEEP_ALIVE_S, now):
            out.append(message(MessageId.KEEP_ALIVE))
        return out

    def _due(self, kind: str, interval: float, now: float) -> bool:
        """True if a kind of message was not sent for `interval` s; it then counts as sent."""
        due = now - self._sent.get(kind, -inf) >= interval
        if due:
            self._sent[kind] = now
        return due

    def receive(self, now: float, datagram: bytes) -> None:
        """Update the session from a datagram of the server. Never raises."""
        parts = split(datagram)
        if parts is None:
            return
        kind, payload = parts
        if kind == MessageId.FRAME and (flags := read_flags(payload)) is not None:
            if self.frames and self.silent(now):
                # Motive was paused or started again, so its ids may have changed meaning.
                self._needs_definitions = True
            self.frames += 1
            self.frame_at = now
            flagged = (FrameFlags.DEFINITIONS_CHANGED in flags, FrameFlags.BITSTREAM_CHANGED in flags)
            if flagged[0] and not self._flagged[0]:
                self._needs_definitions = True
            if flagged[1] and not self._flagged[1]:
                self._needs_server = self._needs_definitions = True
            self._flagged = flagged
        elif kind == MessageId.SERVER_INFO and (info := read_server_info(payload)) is not None:
            if self.server_at is None:
                self.server_at = now
            self._needs_server = False
            if info != self.server:
                self.server = info
                self._needs_definitions = True
        elif kind == MessageId.DEFINITIONS:
            version = self.server.version if self.server else OLDEST
            if read_definitions(payload, version) is not None:
                self._needs_definitions = False
                self.definitions_requested_at = None
