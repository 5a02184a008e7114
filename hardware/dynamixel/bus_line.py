"""One bus of a robot at work: its port, its servos, and registers of all of them written and read at once."""

from collections.abc import Iterable, Sequence
from contextlib import suppress

from hardware.bus import BusSpec
from hardware.dynamixel import protocol1, protocol2
from hardware.dynamixel.control_table import ControlTable, Register, find_table
from hardware.dynamixel.cyclic import CyclicPort, Wired
from hardware.dynamixel.exchange import Ask, Kind, collect, settle
from hardware.dynamixel.readings import Readings
from hardware.dynamixel.serial_port import BytePort
from hardware.dynamixel.settings import ServoImage
from hardware.dynamixel.single_requests import NoAnswer, OneOff, ServoError
from hardware.servo import ServoSpec

TRIES = 3
"""Times that registers of a group are asked for."""


class BusLine:
    """One port and the servos on it. index_of: servo order of the robot, by id."""

    def __init__(self, spec: BusSpec, port: BytePort, servos: Sequence[tuple[int, ServoSpec]]) -> None:
        self.spec, self.port = spec, port
        self.servos = {servo.id: servo for _, servo in servos}
        self.index_of = {servo.id: index for index, servo in servos}
        self.client = OneOff(port, spec.protocol)
        self.images: dict[int, ServoImage] = {}
        """Registers as read last, by id."""
        self._expected = {servo.id: find_table(servo.model.name, spec.protocol) for servo in self.servos.values()}
        self._cyclic = self._wire(self._expected)

    @property
    def where(self) -> str:
        """The bus, in messages."""
        return f"bus {self.spec.name}"

    def name_of(self, device: int) -> str:
        """The servo with this id, in messages."""
        return self.servos[device].label

    @property
    def cyclic(self) -> CyclicPort:
        """The exchange of every cycle."""
        return self._cyclic

    def adopt(self, images: dict[int, ServoImage]) -> None:
        """Use the registers as read: the firmware of a servo chooses its table. Others keep the usual one."""
        before = self.tables, self.longest_delay
        self.images = images
        if (self.tables, self.longest_delay) != before:
            self._cyclic = self._wire(self.tables)

    @property
    def tables(self) -> dict[int, ControlTable]:
        """Control tables of all its servos, by id."""
        return self._expected | {device: image.table for device, image in self.images.items()}

    def write_all(self, register: Register, values: Iterable[tuple[int, int]]) -> None:
        """Send (id, counts) for one register; no servo answers. Raises BusError when the port is gone."""
        items = [(device, register.encode(value)) for device, value in values]
        if not items:
            return
        make = protocol1.sync_write if self.spec.protocol == 1 else protocol2.sync_write
        self._cyclic.post(make(register.address, register.size, items))

    def read_all(self, register: Register, ids: Sequence[int]) -> dict[int, int]:
        """Counts of one register by id, of those that answer. Raises BusError when the port is gone."""
        said = self.read_span(register.address, register.size, ids)
        return {device: register.decode(data) for device, data in said.items()}

    def read_span(self, address: int, size: int, ids: Sequence[int]) -> dict[int, bytes]:
        """`size` bytes from `address` by id, of those that answer. Raises BusError when the port is gone."""
        found: dict[int, bytes] = {}
        if self.spec.protocol == 1:  # no group read that all models have
            for device in ids:
                with suppress(NoAnswer, ServoError):
                    found[device] = self.client.read_block(device, address, size)
            return found
        silent = list(ids)
        for _ in range(TRIES):
            if silent:
                found |= self._ask(Ask(Kind.SYNC, tuple(silent), address, size))
            silent = [device for device in silent if device not in found]
            # The first one silent may have silenced the rest: it is asked last.
            silent = [*silent[1:], *silent[:1]]
        for device in silent:  # one by one, a missing servo silences no other
            found |= self._ask(Ask(Kind.SYNC, (device,), address, size))
        return found

    def _ask(self, ask: Ask) -> dict[int, bytes]:
        sent = self._cyclic.ask(ask.request())
        answers, _ = collect(self.port, ask, sent, ask.timeouts(self.port, self.longest_delay))
        if len(answers) < len(ask.ids):
            settle(self.port)
        return {status.id: status.data for status in answers.statuses}

    @property
    def longest_delay(self) -> float:
        """Longest pause, s, of a servo before it answers: as read, else as it is to be."""
        read = [image.value("return_delay_time") * 2e-6 for image in self.images.values()]
        return max([*read, self.spec.return_delay])

    def _wire(self, tables: dict[int, ControlTable]) -> CyclicPort:
        wired = [Wired(self.index_of[device], device, table) for device, table in tables.items()]
        return CyclicPort(self.port, wired, return_delay=self.longest_delay)


# One cycle of several buses at once, for the bus that drives servos and for the one that only reads them.


def read_cycle(lines: Sequence[BusLine], readings: Readings, *, wide: bool) -> None:
    """Ask all servos, on all ports at once; then ask one with an alert on each bus for its status. wide: voltage and
    temperature too.

    Raises BusError when a port is gone.
    """
    readings.begin()
    for line in lines:
        line.cyclic.begin(wide=wide)
    _exchange(lines, readings)
    for line in lines:
        line.cyclic.end(readings)
    for line in lines if (alarmed := readings.alarmed()) else ():
        for device in [device for device, index in line.index_of.items() if index in alarmed][:1]:
            line.cyclic.ask_status([device])
    _exchange(lines, readings)


def _exchange(lines: Sequence[BusLine], readings: Readings) -> None:
    """Send a request on every port, then wait for each, until no port has a request left."""
    busy = [line.cyclic for line in lines if line.cyclic.busy]
    while busy:
        for cyclic in busy:
            cyclic.send()
        for cyclic in busy:
            cyclic.collect(readings)
        busy = [cyclic for cyclic in busy if cyclic.busy]
