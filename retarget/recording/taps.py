"""What stands between a run and its clock, bus, samples and watch while it is recorded: all pass through, copied."""

from hardware.bus import ServoBus, ServoGoals, ServoStates
from hardware.clock import Clock
from retarget.clip import Clip
from retarget.frames import SensorSample
from retarget.recording.cycles import READINGS, Done
from retarget.recording.note import Note
from retarget.samples import Samples

__all__ = ["TappedBus", "TappedClock", "TappedSamples"]


class TappedClock:
    """A `Clock` whose readings are noted."""

    def __init__(self, inner: Clock, note: Note) -> None:
        self.inner, self._note = inner, note

    def now(self) -> float:
        """The time in s."""
        now = self.inner.now()
        ring = self._note.ring
        if ring is not None:
            rows, at = ring.rows, ring.at
            self._note.now = now
            reading = rows.readings[at]
            if reading < READINGS:
                rows.clock[at, reading] = now
                rows.readings[at] = reading + 1
        return now

    def sleep_until(self, deadline: float) -> None:
        """Return at `deadline`, s."""
        self._note.before()
        self.inner.sleep_until(deadline)


class TappedBus:
    """A `ServoBus` of which it is noted what the servos said and what they were sent."""

    def __init__(self, inner: ServoBus, note: Note) -> None:
        self._inner, self._note = inner, note

    def open(self) -> None:
        """Open the ports."""
        self._inner.open()

    def read(self) -> ServoStates:
        """Read one cycle."""
        note = self._note
        note.look()
        try:
            states = self._inner.read()
        except Exception as error:
            note.failed("bus", "read", error)
            raise
        ring = note.ring
        if ring is not None:
            rows, at = ring.rows, ring.at
            rows.read[at] = Done.WELL
            rows.bus_time[at], rows.retries[at], rows.rough[at] = states.time, states.retries, states.rough
            rows.position[at], rows.velocity[at], rows.current[at] = states.position, states.velocity, states.current
            rows.voltage[at], rows.temperature[at], rows.age[at] = states.voltage, states.temperature, states.age
            rows.error[at], rows.alert[at] = states.error, states.alert
            rows.valid[at], rows.driven[at] = states.valid, states.driven
        return states

    def write(self, goals: ServoGoals) -> None:
        """Send goal positions."""
        ring = self._note.ring
        if ring is not None:
            ring.rows.goal[ring.at] = goals.ticks
            ring.rows.written[ring.at] = Done.WELL
        try:
            self._inner.write(goals)
        except Exception as error:
            self._note.failed("bus", "write", error)
            raise

    def torque(self, on: bool) -> None:
        """Switch the torque of all servos."""
        try:
            self._inner.torque(on)
        except Exception as error:
            self._note.failed("bus", "torque", error)
            raise
        self._note.say("bus", f"torque {'on' if on else 'off'}")

    def close(self) -> None:
        """Close the ports."""
        self._inner.close()


class TappedSamples:
    """`Samples` of which it is noted what was followed."""

    def __init__(self, inner: Samples, note: Note) -> None:
        self._inner, self._note = inner, note
        self.ticks, self.kept, self.dt, self.motion_dt = inner.ticks, inner.kept, inner.dt, inner.motion_dt

    @property
    def over(self) -> bool:
        """Whether the performance has ended before its last tick."""
        over = self._inner.over
        if over:
            self._note.over()
        return over

    @property
    def settled(self) -> float:
        """How much of its speed the robot may use beyond that of its slow approach, 0 to 1."""
        settled, ring = self._inner.settled, self._note.ring
        if ring is not None:
            ring.rows.settled[ring.at] = settled
        return settled

    @property
    def hindrance(self) -> str:
        """Why nobody is followed."""
        return self._inner.hindrance

    def may_approach(self) -> bool:
        """Whether the robot is to go on with its approach."""
        may = self._inner.may_approach()
        if may:
            self._note.approach()
        return may

    def listen(self) -> None:
        """Take in what has arrived."""
        self._inner.listen()

    def sample(self, tick: int) -> SensorSample | None:
        """What the sensors say at a tick."""
        sample, ring = self._inner.sample(tick), self._note.ring
        if ring is None:
            return sample
        rows, at = ring.rows, ring.at
        rows.tick[at], rows.settled[at] = tick, 1.0
        if sample is None:
            rows.sampled[at] = Done.FAILED
            return None
        rows.sampled[at] = Done.WELL
        rows.sensor_position[at], rows.sensor_orientation[at] = sample.position, sample.orientation
        rows.sensor_valid[at] = sample.valid
        rows.weighted[at] = sample.weight is not None
        if sample.weight is not None:
            rows.sensor_weight[at] = sample.weight
        return sample

    def recorded(self) -> Clip:
        """What was said at the ticks that were followed."""
        return self._inner.recorded()
