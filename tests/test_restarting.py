"""Servos started anew, seen to be back."""

from bus_rig import BusRig, bus_of, specs
from hardware.dynamixel.bus_line import BusLine
from hardware.dynamixel.restarting import PATIENCE, restart
from sim.emulator.faults import Fault, FaultKind


def _line(rig: BusRig) -> BusLine:
    rig.port.open(2_000_000)
    return BusLine(bus_of(rig.servos), rig.port, list(enumerate(rig.servos)))


def test_those_named_begin_anew_and_no_other() -> None:
    rig = BusRig(specs(3))
    line = _line(rig)
    for one in rig.devices:
        one.memory.put("led", 1)
    done = restart(line, [1, 3])
    assert done.ids == (1, 3) and done.problems == ()
    assert rig.shown("led") == [0, 1, 0]


def test_stopped_before_the_second_leaves_it_and_still_sees_the_first_back() -> None:
    rig = BusRig(specs(3))
    line = _line(rig)
    for one in rig.devices:
        one.memory.put("led", 1)
    asked: list[bool] = []

    def stop() -> bool:
        asked.append(True)
        return len(asked) > 1

    done = restart(line, [1, 2, 3], stop)
    assert done.ids == (1,) and done.problems == ()
    assert rig.shown("led") == [0, 1, 1] and not rig.devices[0].booting(rig.clock.now())


def test_one_that_stays_away_is_named_in_bounded_time() -> None:
    rig = BusRig(specs(2))
    line = _line(rig)
    rig.fault(Fault(FaultKind.MISSING, ids=(2,)))
    begun = rig.clock.now()
    done = restart(line, [1, 2])
    assert done.ids == (1, 2) and done.problems == ("j2 (id 2) has not come back: check its power and its wiring",)
    assert rig.clock.now() - begun < PATIENCE + 1.0
