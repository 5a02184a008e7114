"""One cycle of several buses at once: who drives servos and who only watches them read alike."""

from collections.abc import Sequence

from hardware.dynamixel.bus_line import BusLine
from hardware.dynamixel.readings import Readings


def read_cycle(lines: Sequence[BusLine], readings: Readings, *, wide: bool) -> None:
    """Ask everybody, on all ports at once; then who has something to add. wide: voltage and temperature too.

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
            line.cyclic.ask_status(device)
    _exchange(lines, readings)


def _exchange(lines: Sequence[BusLine], readings: Readings) -> None:
    """Until no port has a request left: ask on all, then wait for each."""
    busy = [line.cyclic for line in lines if line.cyclic.busy]
    while busy:
        for cyclic in busy:
            cyclic.send()
        for cyclic in busy:
            cyclic.collect(readings)
        busy = [cyclic for cyclic in busy if cyclic.busy]
