"""All servos of a robot on their Dynamixel buses, as a `hardware.bus.ServoBus`; and a reader that writes nothing."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from enum import Enum

import numpy as np

from hardware.arrays import TickArray
from hardware.bno08x import SerialImu
from hardware.bus import BusSpec, ServoGoals, ServoStates, check_open
from hardware.dynamixel.checks import alert_text
from hardware.dynamixel.cyclic import BusLine, read_cycle
from hardware.dynamixel.opencr import OpenCrImu
from hardware.dynamixel.opening import Opening, examine
from hardware.dynamixel.readings import Readings, ReportedTorque
from hardware.dynamixel.serial_port import BytePort
from hardware.dynamixel.torque import BusDrive, Ready, check_still, off_everywhere, prepare, raise_drive, switch_on
from hardware.errors import BusError, HardwareError
from hardware.imu import FRESH, ImuDevice, ImuFault, ImuKind, ImuSample, ImuSpec
from hardware.joint_map import JointMap, resolve_turns, turn_groups

MakePort = Callable[[BusSpec], BytePort]

FIRST_CYCLES = 5
"""Bound of the cycles that wait for silent servos."""
NOISY_CYCLES = 50
"""Consecutive cycles with retries that cause a note."""


class CyclicImu:
    """The IMU of a robot within the cycles of its bus. port: its own serial line, if any.

    It is polled after the goals, or else after the servos, and its answer is taken before anything else is sent.
    notify: receives each fault once.
    """

    def __init__(
        self, spec: ImuSpec, lines: Sequence[BusLine], make_port: MakePort, notify: Callable[[str], object]
    ) -> None:
        self._baud, self._notify, self._notified = spec.baud, notify, set[ImuFault]()
        self._requested = self._answers = self._late = False
        self._since = np.inf  # [s] from when on there are answers
        self.port: BytePort | None = None
        self.device: ImuDevice
        if spec.kind is ImuKind.BNO08X:
            self.port = make_port(BusSpec("imu", spec.port, spec.baud, 2, ()))
            self.device = SerialImu(spec, self.port)
        else:
            (line,) = (line for line in lines if line.spec.name == spec.bus)
            self.device = OpenCrImu(line, spec)

    def open(self) -> None:
        """Open its own port, if any."""
        if self.port is not None:
            self.port.open(self._baud)

    def post(self) -> None:
        """Request a measurement after the goals. A host that had to wait for the last answer skips one."""
        self.finish()
        if not self._late:
            self.device.post()
            self._requested = self._answers = True
        self._late = False

    def finish(self) -> None:
        """Take the pending answer, before which nothing else may be sent."""
        if self._answers:
            self._answers = False
            try:
                self._late = self.device.collect()
            except BusError:
                if self.port is None:
                    raise

    def sample(self, now: float, *, request: bool = True) -> ImuSample:
        """The newest measurement at the end of a cycle that began at `now`, s. request: request a new one and
        wait."""
        if request:
            self._late = False
            self.post()
            self.finish()
            self._late = False
        sample, fault = self.device.tracker.sample(now), self.device.tracker.fault
        self._since = min(self._since, now if self._requested else np.inf)
        if fault is not None and fault not in self._notified and now > self._since + FRESH:
            self._notified.add(fault)
            with suppress(OSError):  # a lost terminal is no failure of the bus
                self._notify(f"the IMU {fault.value}: nothing is known of the robot's tilt meanwhile")
        return sample

    def rest(self) -> None:
        """Pause without a fault."""
        self._requested, self._since = False, np.inf

    def close(self) -> None:
        """Close its own port."""
        if self.port is not None:
            with suppress(BusError):
                self.port.close()


class BusState(Enum):
    """State of all ports of a robot."""

    CLOSED = "closed"
    OPEN = "open"
    POWERED = "torque may be on, through this bus"


class DynamixelBus:
    """All buses of a robot. Each cycle sends on every port before it waits on any. Torque comes on by a ramp, after all
    servos were provisioned."""

    def __init__(
        self,
        joint_map: JointMap,
        buses: Sequence[BusSpec],
        make_port: MakePort,
        *,
        imu: ImuSpec | None = None,
        notify: Callable[[str], object] = lambda note: None,
    ) -> None:
        self._map = joint_map
        self._notify = notify
        servos = list(enumerate(joint_map.servos))
        placed = [(bus, [(index, servo) for index, servo in servos if servo.bus == bus.name]) for bus in buses]
        self.lines = tuple(BusLine(bus, make_port(bus), own) for bus, own in placed if own)
        self.imu = None if imu is None else CyclicImu(imu, self.lines, make_port, notify)
        self._readings: Readings
        self._goals: TickArray | None = None
        self._only_read = False  # since the last goals that drive servos
        self._noisy_cycles = 0  # cycles
        self._drives: Sequence[BusDrive] = ()  # of servos whose torque this bus has switched on
        self._state = BusState.CLOSED

    @property
    def retries(self) -> int:
        """Requests repeated so far."""
        return sum(line.cyclic.errors.retries for line in self.lines)

    def open(self) -> None:
        """Open the ports, examine every servo, write the profile's values.

        Raises BusError with all problems of all ports, before any servo is written. If a servo refuses a value, the
        message lists what others have taken.
        """
        if self._state is not BusState.CLOSED:
            raise BusError("the bus is open already", where="bus, open", then="Call close first")
        try:
            found = []
            for line in self.lines:  # all of them, also after a problem of one
                try:
                    line.port.open(line.spec.baud)
                    found.append(examine(line, self._map))
                except HardwareError as error:
                    found.append(Opening(problems=[f"bus {line.spec.name}: {error}"]))
            if self.imu is not None:
                try:
                    self.imu.open()
                except HardwareError as error:
                    found.append(Opening(problems=[f"IMU: {error}"]))
            problems = [problem for opening in found for problem in opening.problems]
            if problems:
                several = [f"the bus cannot be used, for {len(problems)} reasons:"] if len(problems) > 1 else []
                raise BusError("\n  ".join([*several, *problems]))
            for note in [note for opening in found for note in opening.notes]:
                self._notify(note)
            prepare(self.lines, self._notify, limp_only=True)
            self._begin()
        except BaseException:
            self._close_ports()
            raise
        self._state = BusState.OPEN

    def read(self) -> ServoStates:
        """Run one cycle of all ports. It waits for the IMU from the second consecutive read without goals on, since the
        first may be the posture to hold."""
        check_open(self._state is not BusState.CLOSED, where="bus, read")
        request, self._only_read = self._only_read, True
        return self._cycle(request_imu=request)

    def write(self, goals: ServoGoals) -> None:
        """Send goals, one sync write per port."""
        check_open(self._state is not BusState.CLOSED, where="bus, write")
        ticks = goals.ticks
        self._map.check_goals(ticks, where="bus, write")
        self._finish_imu()
        self._goals = np.array(ticks)
        raw = ticks - self._readings.turns
        for line in self.lines:
            line.cyclic.write(raw, self._readings.driven)
        if self.imu is not None and self._state is BusState.POWERED:
            self.imu.post()
            self._only_read = False

    def limit_drive(self, share: float) -> None:
        """Limit the drive of servos with torque, one packet per port."""
        check_open(self._state is not BusState.CLOSED, where="bus, limit_drive")
        self._finish_imu()
        driven = self._readings.driven
        for drive in self._drives:
            drive.limit(share, driven)

    def torque(self, on: bool) -> None:
        """See `ServoBus`. Torque rises within half a second."""
        check_open(self._state is not BusState.CLOSED, where="bus, torque")
        self._only_read = False
        if not on:
            with suppress(BusError):  # its port may be gone; the servos' torque comes first
                self._finish_imu()
            self._torque_off()
            return
        if self.imu is not None:
            self.imu.finish()
            self.imu.rest()
        try:
            self._torque_on()
        except BaseException:
            if self._state is BusState.POWERED:
                with suppress(BusError):  # the first error is the one to raise
                    self._torque_off()
            raise

    def close(self) -> None:
        """See `ServoBus`."""
        if self._state is BusState.CLOSED:
            return
        try:
            if self._state is BusState.POWERED:
                self._torque_off()
        finally:
            self._state = BusState.CLOSED
            self._close_ports()

    def _begin(self) -> None:
        """Read all servos once, and find forgotten turns."""
        servos = self._map.servos
        tables = {line.index_of[device]: image.table for line in self.lines for device, image in line.images.items()}
        self._readings = Readings([tables[index] for index in range(len(servos))])
        self._goals, self._only_read = None, False
        self._counted = np.ones(len(servos), dtype=np.bool_)  # whose turns are known
        for group in turn_groups(self._map):
            self._counted[group] = False
        valid = self._cycle_of_all().valid
        with suppress(BusError):  # it can be read and homed, but not driven: torque on counts again
            self._count_turns(np.flatnonzero(valid).tolist())

    def _count_turns(self, columns: Iterable[int]) -> None:
        """Find the whole turns of the servos `columns`. Raises BusError for those that are ambiguous."""
        states = self._readings.states(self.lines[0].port.now())
        shown, turns = states.position - self._readings.turns, self._readings.turns.copy()
        affected, problems = set(columns), list[str]()
        for group in turn_groups(self._map):
            if not affected.intersection(group):
                continue
            self._counted[group] = False
            try:
                turns[group] = resolve_turns(self._map, shown, groups=[group])[group]
                self._counted[group] = True
            except HardwareError as error:
                problems.append(str(error))
        self._readings.turns = turns
        if problems:
            raise BusError(" ".join(problems))

    def _cycle(self, *, request_imu: bool = False) -> ServoStates:
        """Run one cycle of all ports. request_imu: wait for a new IMU sample."""
        now = self.lines[0].port.now()
        self._finish_imu()
        read_cycle(self.lines, self._readings, wide=self._readings.slow.due(now, self._readings.valid))
        imu = None if self.imu is None else self.imu.sample(now, request=request_imu)
        errors = [line.cyclic.errors for line in self.lines]
        repeated = sum([one.note(now) for one in errors])
        share = max(one.share for one in errors)
        self._noisy_cycles = self._noisy_cycles + 1 if repeated else 0
        if self._noisy_cycles == NOISY_CYCLES:
            with suppress(OSError):  # a lost terminal is no failure of the bus
                self._notify(
                    f"requests had to be repeated in {NOISY_CYCLES} cycles in a row: a noisy line, or an adapter that "
                    "is slower than it says"
                )
        return self._readings.states(now, retries=self.retries, error_rate=share, imu=imu)

    def _finish_imu(self) -> None:
        if self.imu is not None:
            self.imu.finish()

    def _cycle_of_all(self) -> ServoStates:
        states = self._cycle()
        for _ in range(FIRST_CYCLES - 1):
            if states.complete:
                break
            states = self._cycle()
        return states

    def _torque_on(self) -> None:
        """Provision servos that have restarted, check goals, arm watchdogs, then raise the drive."""
        if self._goals is None:
            raise BusError("no goals were sent", where="bus, torque on", then="Send the present posture first")
        ready = prepare(self.lines, self._notify)
        self._recount(ready)
        raw = self._goals - self._readings.turns
        goals = [{device: int(raw[index]) for device, index in line.index_of.items()} for line in self.lines]
        for line, own in zip(self.lines, goals, strict=True):
            check_still(line, own)
        self._state = BusState.POWERED
        self._drives = drives = switch_on(ready, goals)
        self._readings.drive[:] = ReportedTorque.ON
        raise_drive(self.lines, drives, self._watch_rise)

    def _recount(self, ready: Sequence[Ready]) -> None:
        """Count the turns of limp and uncounted servos. Raises BusError if they are unknown or have changed."""
        states = self._cycle_of_all()
        if not states.complete:
            silent = [servo.label for servo, valid in zip(self._map.servos, states.valid, strict=True) if not valid]
            raise BusError(f"no answer from {', '.join(silent)}", where="bus, torque on")
        before = self._readings.turns
        limp = {line.index_of[device] for line, off in ready for device in off}
        self._count_turns(limp | set(np.flatnonzero(~self._counted).tolist()))
        moved = np.flatnonzero(self._readings.turns != before)
        if moved.size:
            raise BusError(
                "servos have restarted, and their turns are counted from another one",
                where="bus, torque on",
                found=", ".join(self._map.servos[index].label for index in moved),
                then="Torque was not switched on. Read the posture, send it, and try again",
            )

    def _watch_rise(self) -> None:
        """Run a cycle. Raises BusError for a servo with an error or without torque."""
        states = self._cycle()
        wrong = np.flatnonzero(states.alert.astype(bool) | ~states.driven)
        if wrong.size:
            texts = [alert_text(int(states.alert[k])) or "lost its torque" for k in wrong]
            names = [f"{self._map.servos[k].label} {text}" for k, text in zip(wrong, texts, strict=True)]
            raise BusError("torque did not come up", where="bus", found=", ".join(names))

    def _torque_off(self) -> None:
        unsure = off_everywhere({line: line.servos for line in self.lines})
        self._readings.drive[:] = ReportedTorque.OFF
        if unsure:
            raise BusError(
                f"{', '.join(unsure)} did not confirm that torque is off", where="bus", then="Cut the power by hand"
            )
        self._state = BusState.OPEN

    def _close_ports(self) -> None:
        for line in self.lines:
            with suppress(BusError):
                line.port.close()
        if self.imu is not None:
            self.imu.close()


KEPT = 500
TORQUE_PERIOD = 0.2
"""[s] Between two reads of the torque of all servos."""
TORQUE_AGE = 1.0
"""[s] Age of the last answer beyond which a servo's torque is unknown."""


class BusWatch:
    """Reads the servos of open lines, and writes no register. losses (n,): cycles without an answer from a servo."""

    def __init__(self, lines: Sequence[BusLine], imu: CyclicImu | None = None) -> None:
        self._lines, self._imu = lines, imu
        tables = {line.index_of[one]: table for line in lines for one, table in line.tables.items()}
        self._readings = Readings([tables[index] for index in range(len(tables))])
        self.losses = np.zeros(len(tables), dtype=np.int64)
        self._times: deque[float] = deque(maxlen=KEPT)
        self._looked = -np.inf  # [s] of the last read of torque
        for line in lines:
            for device, image in line.images.items():
                if image.has("hardware_error_status"):
                    self._readings.take_alert(line.index_of[device], image.value("hardware_error_status"))

    @property
    def torque(self) -> list[ReportedTorque]:
        """Torque of every servo that has answered within TORQUE_AGE."""
        recent = self._readings.states(self._lines[0].port.now()).age < TORQUE_AGE
        return [ReportedTorque(one) for one in np.where(recent, self._readings.drive, ReportedTorque.UNKNOWN).tolist()]

    @property
    def retries(self) -> int:
        """Requests repeated so far."""
        return sum(line.cyclic.errors.retries for line in self._lines)

    def times(self) -> tuple[float, float]:
        """The median and 99th percentile of the cycle times, s."""
        low, high = np.percentile(self._times, (50, 99)) if self._times else (np.nan, np.nan)
        return float(low), float(high)

    def read(self) -> ServoStates:
        """Run one cycle with voltage and temperature."""
        begun = self._lines[0].port.now()
        look = begun >= self._looked + TORQUE_PERIOD
        self._looked = begun if look else self._looked
        read_cycle(self._lines, self._readings, wide=True, status=look)
        imu = None if self._imu is None else self._imu.sample(self._lines[0].port.now())
        now = self._lines[0].port.now()
        self._times.append(now - begun)
        states = self._readings.states(now, imu=imu)
        self.losses += ~states.valid
        return states
