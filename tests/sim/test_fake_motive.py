"""The fake Motive against the session and the decoder: a whole conversation on virtual time."""

import numpy as np
import pytest

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
