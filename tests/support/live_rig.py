"""A live run of OP3 on virtual time, with a sender of JSON poses."""

from collections.abc import Iterator
from contextlib import contextmanager

from hardware.clock import Clock, VirtualClock
from retarget.human.samples import Performance
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.open_stream import open_stream
from retarget.live.stream import LiveStream
from retarget.model.robot import RobotBody
from retarget.recording.recorder import Recorder
from retarget.run.options import RunOptions
from retarget.run.prepare import Prepared, prepare_for
from retarget.schema.performer import Performer, load_performer
from sim.faults.sender import FakeSender
from sim.mock_bus import MockBus, mock_bus

WHERE = "json://:7000"


def live_stream(sender: FakeSender, performer: Performer) -> LiveStream:
    """A stream from the sender."""
    return open_stream(None, performer, receiver=sender)


class LiveRig:
    """A live run of OP3 on a mock bus. said: messages to the performer and the user."""

    def __init__(self, sender: FakeSender, *, robot: str = "op3", options: LiveOptions | None = None) -> None:
        self.sender, self.clock, self.said = sender, VirtualClock(), list[str]()
        self.live = options or LiveOptions(countdown=0.5, duration=6.0)
        self.run_options = RunOptions(robot=robot)
        self.stream: LiveStream
        self.bus: MockBus

    @contextmanager
    def prepared(self, recorder: Recorder | None = None) -> Iterator[Prepared]:
        """Calibrated, and the bus open."""

        def perform(performer: Performer, robot: RobotBody | None) -> Performance:
            self.stream = live_stream(self.sender, performer)
            rate = 100.0 if robot is None else robot.profile.safety.rate_hz
            return begin_live(
                self.stream, self.live, clock=self.clock, rate_hz=rate, where=WHERE, notify=self.said.append
            )

        clock = self.clock if recorder is None else recorder.clock
        make_bus = self._bus if recorder is None else recorder.make_bus(self._bus)
        with prepare_for(perform, self.run_options, clock=clock, make_bus=make_bus, goes_to_rest=True) as prepared:
            yield prepared

    def _bus(self, robot: RobotBody, clock: Clock) -> MockBus:
        self.bus = mock_bus(robot, clock)
        return self.bus


def five() -> Performer:
    """Head, wrists, ankles."""
    return load_performer("five")
