"""The fake Motive against the session and the decoder: a whole conversation on virtual time."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fake_motive import FakeMotive, MotiveSettings
from messages import shows
from natnet_packets import VERSIONS
from retarget.frames import SensorFrames
from retarget.rotations import angle_between
from retarget.sources.natnet_decoder import NatnetDecoder
from retarget.sources.natnet_session import NatnetSession, natnet_problems
from retarget.sources.natnet_wire import Version
from retarget.sources.stream_frame import StreamFrame
from sim.performer import synthetic_performer

STEP_S = 1 / 200
GROUP = ("239.255.42.99", 1511)


@pytest.fixture(scope="module")
def motion() -> SensorFrames:
    return synthetic_performer(0)


class Lab:
    """Server, session and decoder on one wire; `lost` datagrams to the server vanish."""

    def __init__(self, server: FakeMotive, session: NatnetSession, decoder: NatnetDecoder | None = None) -> None:
        self.server, self.session, self.decoder = server, session, decoder or NatnetDecoder()
        self.lost = False
        self.now = 10.0
        self.asked: list[bytes] = []

    def run(self, seconds: float) -> list[StreamFrame]:
        frames = []
        for _ in range(round(seconds / STEP_S)):
            asked = self.session.poll(self.now)
            self.asked += asked
            answers = [] if self.lost else [got for sent in asked for got in self.server.receive(self.now, sent)]
            for datagram in answers + self.server.due(self.now):
                self.session.receive(self.now, datagram)
                frames += self.decoder.decode(datagram)
            self.now += STEP_S
        return frames

    def problems(self) -> list[str]:
        return [problem.render() for problem in natnet_problems(self.session, self.now, host="lab")]


@pytest.mark.parametrize("version", VERSIONS, ids=str)
def test_the_motion_arrives_as_it_was(version: Version, motion: SensorFrames) -> None:
    lab = Lab(FakeMotive(motion, MotiveSettings(version=version)), NatnetSession())
    frames = lab.run(1.0)
    assert motion.rate_hz is not None
    assert len(frames) == pytest.approx(motion.rate_hz, abs=3)
    named = [frame for frame in frames if frame.names[0].startswith("rigid://h")]
    assert len(frames) - len(named) <= 1
    for frame in named:
        assert frame.number is not None and frame.stamp is not None
        row = frame.number % len(motion.time)
        assert frame.names == tuple(f"rigid://{name}" for name in motion.names)
        np.testing.assert_allclose(frame.position, motion.position[row], atol=1e-6)
        assert float(angle_between(frame.orientation, motion.orientation[row]).max()) < 1e-6
        assert frame.stamp == pytest.approx(1000.0 + frame.number / motion.rate_hz, abs=1e-6)
    assert lab.decoder.dropped.count == 0
    assert lab.problems() == []


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("transport", ["unicast", "multicast"])
def test_settings_that_agree(up: Any, transport: Any, motion: SensorFrames) -> None:
    server = FakeMotive(motion, MotiveSettings(transport=transport, up=up, version=Version(4, 4)))
    session = NatnetSession(group=GROUP if transport == "multicast" else None)
    frame = Lab(server, session, NatnetDecoder(up=up)).run(0.5)[-1]
    assert frame.number is not None
    np.testing.assert_allclose(frame.position, motion.position[frame.number % len(motion.time)], atol=1e-6)


@pytest.mark.parametrize("mine", ["unicast", "multicast"])
def test_settings_that_disagree_are_said(mine: str, motion: SensorFrames) -> None:
    session = NatnetSession(group=GROUP if mine == "multicast" else None)
    server = FakeMotive(motion, MotiveSettings(transport="multicast" if mine == "unicast" else "unicast"))
    lab = Lab(server, session)
    lab.server.streaming = False
    lab.run(3.0)
    (text,) = lab.problems()
    shows(text)


def test_signs_of_life_keep_a_unicast_server_sending(motion: SensorFrames) -> None:
    lab = Lab(FakeMotive(motion, MotiveSettings(patience_s=2.0)), NatnetSession())
    assert len(lab.run(4.0)) == pytest.approx(4 * 120, abs=5)
    lab.lost = True
    assert len(lab.run(5.0)) == pytest.approx(2 * 120, abs=130)
    (text,) = lab.problems()
    shows(text)
    lab.lost = False
    assert len(lab.run(2.0)) > 100
    assert lab.problems() == []


def test_new_names_are_learnt(motion: SensorFrames) -> None:
    lab = Lab(FakeMotive(motion), NatnetSession())
    lab.run(1.0)
    lab.server.rename([f"new {i}" for i in range(len(motion.names))])
    assert lab.run(0.5)[-1].names[0] == "rigid://new 0"


def test_a_server_that_starts_late_and_pauses(motion: SensorFrames) -> None:
    lab = Lab(FakeMotive(motion), NatnetSession())
    lab.server.answering = False
    assert lab.run(5.0) == []
    shows(lab.problems()[0])
    lab.server.answering = True
    assert len(lab.run(2.0)) > 100
    lab.server.streaming = False
    lab.run(3.0)
    shows(lab.problems()[0])
    lab.server.streaming = True
    assert len(lab.run(1.0)) > 100
    assert lab.problems() == []


@given(noise=st.lists(st.tuples(st.integers(0, 15), st.binary(max_size=300)), max_size=20))
@settings(max_examples=15)
def test_noise_is_borne(noise: list[tuple[int, bytes]], motion: SensorFrames) -> None:
    lab = Lab(FakeMotive(motion), NatnetSession())
    for kind, payload in noise:
        lab.server.receive(lab.now, payload)
        lab.server.receive(lab.now, bytes((kind, 0)) + len(payload).to_bytes(2, "little") + payload)
    assert len(lab.run(0.1)) > 5
    assert lab.decoder.dropped.count == 0
