"""`retarget run --record`: records a run while it goes on. The tick copies, a thread of its own writes."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from hardware.clock import Clock, MonotonicClock, VirtualClock, wall_to_monotonic
from retarget.human.reconstruction import Reconstructor
from retarget.model.human_dimensions import POINTS
from retarget.recording.cycles import Asked
from retarget.recording.mcap_writer import OPTION, RecordingFile, Ring, WritingThread, check_target
from retarget.recording.session import config_files, session_of
from retarget.recording.taps import Note, TappedBus, TappedClock, TappedSamples
from retarget.recording.topics import Topic, topics
from retarget.run.loop import ObserverCallback, Watch
from retarget.run.options import RunOptions
from retarget.run.prepare import MakeBus, Prepared
from retarget.run.run_result import truth_names
from retarget.run.table import Widths
from retarget.schema.files import refuse_existing, remove
from retarget.types import FloatArray, Notify

SWITCH_S = 1e-3
"""Time, s, that a tick that is due may wait for the interpreter while the writing thread encodes; usually it is 5
ms."""


class Recorder:
    """Records one run. path: None: nothing is recorded, and nothing is changed.

    clock: of the run; where its time is not real, the run may wait for the disk, else what comes while the disk hangs
    is counted and missing. notify: called with what became of the recording.
    """

    def __init__(
        self,
        path: Path | None,
        options: RunOptions,
        *,
        clock: Clock,
        notify: Notify,
        overwrite: bool = False,
        truth: Callable[[], FloatArray | None] = lambda: None,
    ) -> None:
        """Raises UsageError for a place at which no recording can be, or where something is, or without the library.

        overwrite: what is there is removed as the recording begins. truth: numbers of a simulated body.
        """
        if path is not None:
            check_target(path)
            if not overwrite:
                refuse_existing(path, option=OPTION)
        self._overwrite = overwrite
        self._path, self._options, self._notify = path, options, notify
        self._note = Note(truth)
        self._clock = clock
        self._thread: WritingThread | None = None
        self._keeps = ObserverCallback(self._note.kept)
        self._warned = ""
        self.clock: Clock = clock if path is None else TappedClock(clock, self._note)
        """Of the guard and the robot's side."""

    @property
    def failure(self) -> str:
        """Why the recording is not whole; "" while it is."""
        return "" if self._thread is None else self._thread.failure or self._keeps.failure or self._missing()

    @property
    def cpu_s(self) -> float:
        """CPU time of the thread that writes, s."""
        return 0.0 if self._thread is None else self._thread.cpu_s

    def make_bus(self, make: MakeBus) -> MakeBus:
        """What makes the run's bus, instead of `make`."""
        if self._path is None:
            return make
        return lambda robot, clock: TappedBus(make(robot, self._clock), self._note)

    def recorded_notify(self, notify: Notify) -> Notify:
        """A `notify` that also records each message, to be used instead."""

        def record_and_notify(text: str) -> None:
            self._note.say("run", text)
            notify(text)

        return notify if self._path is None else record_and_notify

    def watch(self, watch: Watch, prepared: Prepared) -> Watch:
        """A watch that also records what is asked for, to be used instead."""
        if self._path is None:
            return watch
        note, guard = self._note, None if prepared.machine is None else prepared.machine.guard

        def stop_asked() -> bool:
            note.before()
            if not self._warned:
                self._warn_of_failure()
            before = None if guard is None else guard.stop
            answer = watch.stop_asked()
            note.stopped_outside(before)
            if answer:
                note.ask(Asked.STOP)
            return answer

        def torque_off_asked() -> bool:
            note.before()
            answer = watch.torque_off_asked()
            if answer:
                note.ask(Asked.TORQUE_OFF)
            return answer

        return replace(watch, stop_asked=stop_asked, torque_off_asked=torque_off_asked, on_row=self._keeps)

    def code(self, code: int) -> int:
        """The exit code of a run that ended with `code`: a recording that is not whole is a file not written."""
        return max(code, 1) if self.failure else code

    @contextmanager
    def recording(self, prepared: Prepared, *, source: str) -> Iterator[Prepared]:
        """Record while the context lasts what is run of it. Raises UsageError if the file cannot be begun."""
        if self._path is None:
            yield prepared
            return
        started = self._clock.now()
        begun_ns = round(MonotonicClock().now() * 1e9) - wall_to_monotonic()
        session = session_of(prepared, self._options, source=source, begun_ns=begun_ns)
        robot = None if prepared.machine is None else prepared.machine.robot
        if self._overwrite:
            remove(self._path, option=OPTION)
        file = RecordingFile(self._path, session, config_files(self._options, robot))
        shape, messages = _layout(prepared, simulated=self._options.has_physics)
        file.announce(messages)
        ring = Ring(shape, patient=isinstance(self._clock, VirtualClock))
        thread = WritingThread(
            file, ring, self._note.events, messages, lambda time: begun_ns + round((time - started) * 1e9)
        )
        self._note.begin(ring, now=started, dt=prepared.samples.dt, machine=prepared.machine)
        self._thread, self._ring = thread, ring
        thread.start()
        switching = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH_S)
        try:
            yield replace(prepared, samples=TappedSamples(prepared.samples, self._note))
        finally:
            sys.setswitchinterval(switching)
            self._note.end()
            thread.close()
            if not self._note.rows:
                file.discard()  # it was refused, or stopped, before it made a tick
            elif not self.failure:
                self._notify(f"recording: {self._path}, {self._path.stat().st_size / 1e6:.1f} MB")
            elif self.failure != self._warned:
                self._warn_of_failure()

    def _missing(self) -> str:
        lost = self._ring.lost
        return f"the disk was too slow: {lost} ticks are missing" if lost else ""

    def _warn_of_failure(self) -> None:
        """Once while the run goes on; when it has ended, only what is new by then."""
        self._warned = self.failure
        if self._warned:
            self._notify(f"warning: the recording is not whole, the robot goes on: {self._path}: {self._warned}")


def _layout(prepared: Prepared, *, simulated: bool) -> tuple[Widths, list[Topic]]:
    """How wide a cycle is, and the topics."""
    robot = None if prepared.machine is None else prepared.machine.robot
    own = prepared.reconstructor.observers if isinstance(prepared.reconstructor, Reconstructor) else None
    landmarks = () if robot is None else tuple(robot.profile.landmarks)
    observers = 0 if prepared.observers is None else len(prepared.observers.names)
    sensors = tuple(prepared.performer.sensors)
    truth = truth_names(robot.body) if robot is not None and simulated else ()
    shape = {
        "sensors": len(sensors),
        "servos": 0 if robot is None else len(robot.joint_map),
        "rest": 0 if robot is None else robot.body.nq - len(robot.joint_map),
        "human": prepared.human.body.nq,
        "joints": len(POINTS),
        "landmarks": len(landmarks),
        "observers": 0 if robot is None else observers,
        "human_observers": 0 if own is None else len(own.names),
        "truth": len(truth),
    }
    names = {"sensors": sensors, "human_joints": POINTS, "landmarks": landmarks, "truth": truth}
    return shape, topics(shape, dt=prepared.samples.dt, robot=robot, **names)
