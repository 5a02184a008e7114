"""Registers of many servos of one bus, read or written and read back: whoever does not say or keep it is named."""

from collections.abc import Sequence

from hardware.dynamixel.bus_line import BusLine
from hardware.dynamixel.register import Register
from hardware.dynamixel.settings import Setting
from hardware.errors import BusError, describe

UNHEARD = "Check power and wiring, or whether the host is too busy"
TRIES = 2
"""Times that a value is written to servos which do not keep it."""


def register_of(line: BusLine, name: str) -> Register:
    """A register that all servos of a bus keep in one place."""
    return next(iter(line.images.values())).table[name]


def read_everybody(line: BusLine, name: str, ids: Sequence[int]) -> dict[int, int]:
    """A register of servos, counts by id. Raises BusError with those that do not say."""
    found = line.read_all(register_of(line, name), ids)
    silent = [line.name_of(device) for device in ids if device not in found]
    if silent:
        raise BusError(describe(what=f"no answer from {', '.join(silent)}", where=line.where, then=UNHEARD))
    return found


def write_and_read(line: BusLine, wanted: Sequence[tuple[int, Setting]]) -> None:
    """Write one register of several servos, read it back, and write once more what was lost.

    Raises BusError with what is still wrong.
    """
    left = list(wanted)
    kept: dict[int, int] = {}
    for _ in range(TRIES):
        if not left:
            return
        register = left[0][1].register
        line.write_all(register, [(device, setting.value) for device, setting in left])
        kept = line.read_all(register, [device for device, _ in left])
        left = [(device, setting) for device, setting in left if kept.get(device) != setting.value]
    if left:
        raise not_kept(line, [(device, kept.get(device), setting) for device, setting in left])


def not_kept(line: BusLine, wrong: Sequence[tuple[int, int | None, Setting]]) -> BusError:
    """Servos (id, what its register holds, None: it does not say; what it was to hold) that were told in vain."""
    name = wrong[0][2].register.name.replace("_", " ")
    found = ", ".join(
        f"{line.name_of(one)} " + ("silent" if kept is None else f"{kept} instead of {setting.value}")
        for one, kept, setting in wrong
    )
    then = (
        "Try again; where it stays, `retarget servo monitor` shows what they say, `retarget servo setup` their limits"
    )
    return BusError(describe(what=f"servos do not keep their {name}", where=line.where, found=found, then=then))
