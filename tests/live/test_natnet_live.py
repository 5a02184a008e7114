"""Motive's names reach a live stream over real sockets: asked for at the start, and again for ids that are new."""

import select
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

import pytest

from datagrams import CLOCK, PATIENCE_S
from fake_motive import FakeMotive, MotiveSettings
from retarget.frames import SensorFrames
from retarget.live.address import parse_address
from retarget.live.admission import admission_for
from retarget.live.clock_map import ClockMap
from retarget.live.playout import Playout
from retarget.live.receivers import NatnetReceiver, session_for
from retarget.live.roles import roles_of
from retarget.live.sensor_validity import SensorValidity
from retarget.live.stream import LiveStream
from retarget.schema.performer import load_performer
from retarget.sources.natnet_decoder import NatnetDecoder
from retarget.sources.natnet_session import UNNAMED_S
from retarget.sources.natnet_wire import Version
from sim.performer import synthetic_performer

GROUP = "239.255.42.99"
OWN_NAMES = {"head": "head", "l_wrist": "left_wrist", "r_wrist": "right_wrist"}
OWN_NAMES |= {"l_ankle": "left_ankle", "r_ankle": "right_ankle"}
TICK_S = 0.01
Transport = Literal["unicast", "multicast"]


class Lab:
    """A server without cameras on loopback, and a stream from it. Time goes by as fast as both can send."""

    def __init__(self, transport: Transport, server: socket.socket) -> None:
        whole = synthetic_performer()
        columns = [whole.names.index(name) for name in OWN_NAMES]
        motion = SensorFrames(
            time=whole.time,
            names=tuple(OWN_NAMES.values()),
            position=whole.position[:, columns],
            orientation=whole.orientation[:, columns],
            valid=whole.valid[:, columns],
            source="",
            rate_hz=whole.rate_hz,
        )
        query = "" if transport == "unicast" else f"?multicast={GROUP}"
        address = parse_address(f"natnet://127.0.0.1{query}")
        self.motive = FakeMotive(motion, MotiveSettings(transport=transport, version=Version(4, 4)))
        self.requests = 0
        self.decoder = decoder = NatnetDecoder()
        session = session_for(address)
        session.names_missing = lambda: decoder.names_missing
        receiver = NatnetReceiver(address, session, command_port=server.getsockname()[1], wall_offset=None)
        roles = roles_of(load_performer("optitrack"), "natnet", where="test")
        self.stream = LiveStream(
            receiver,
            decoder,
            roles,
            admission=admission_for(address),
            clock_map=ClockMap(),
            validity=SensorValidity(roles.sensors),
            playout=Playout(len(roles.sensors), delay=None),
        )
        self._server, self._receiver, self._transport = server, receiver, transport
        self._client: tuple[str, int] | None = None
        self.now = CLOCK.now()

    def run(self, seconds: float) -> None:
        """Run both sides for some seconds."""
        end = self.now + seconds
        while self.now < end:
            self.now += TICK_S
            self.stream.poll(self.now, moving=False)
            while select.select([self._server], [], [], 0.0)[0]:
                question, self._client = self._server.recvfrom(65_536)
                self.requests += question[:2] == b"\x04\0"
                for answer in self.motive.receive(self.now, question):
                    self._send(answer, self._client)
            to = (GROUP, 1511) if self._transport == "multicast" else self._client
            for frame in self.motive.due(self.now):
                if to is not None:
                    self._send(frame, to)

    def _send(self, datagram: bytes, to: tuple[str, int]) -> None:
        """Send, and wait until it is there."""
        self._server.sendto(datagram, to)
        parts = [part for part in (self._receiver._commands, self._receiver._frames) if part is not None]
        if not select.select(parts, [], [], PATIENCE_S / 5.0)[0]:
            assert to[0] == GROUP, "nothing arrived over loopback"
            pytest.skip("this kernel delivers no multicast over loopback")


@contextmanager
def lab(transport: Transport) -> Iterator[Lab]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        server.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        made = Lab(transport, server)
        try:
            yield made
        finally:
            made.stream.receiver.close()


@pytest.mark.parametrize("transport", ["unicast", "multicast"])
def test_sensors_are_known_by_the_names_that_motive_sends(transport: Transport) -> None:
    with lab(transport) as made:
        made.run(0.5)
        assert made.requests == 1 and made.stream.read(made.now).fresh.all()
        assert set(made.stream.names) >= {f"rigid://{name}" for name in OWN_NAMES.values()}
        made.run(2.5)
        assert made.requests == 1  # no request for what is known


@pytest.mark.parametrize("transport", ["unicast", "multicast"])
def test_bodies_that_are_new_are_asked_for_though_no_flag_says_so(transport: Transport) -> None:
    with lab(transport) as made:
        made.run(0.5)
        made.motive.rename([f"new_{name}" for name in OWN_NAMES.values()], first_id=100, announced=False)
        made.run(1.2)  # no two questions within a second
        assert made.requests == 2 and not made.decoder.names_missing
        assert "rigid://new_head" in made.stream.names
        made.motive.rename(list(OWN_NAMES.values()), first_id=200, announced=False)
        made.run(UNNAMED_S + 0.2)
        assert made.requests == 3 and made.stream.read(made.now).fresh.all()


@pytest.mark.parametrize("transport", ["unicast", "multicast"])
def test_a_change_that_is_flagged_is_asked_about_at_once(transport: Transport) -> None:
    with lab(transport) as made:
        made.run(0.5)
        made.motive.rename([f"new_{name}" for name in OWN_NAMES.values()])
        made.run(1.2)
        assert made.requests == 2 and "rigid://new_head" in made.stream.names
