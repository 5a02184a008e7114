"""The emulated buses of a robot: the servos of its profile, and what else it expects on them."""

from collections.abc import Sequence

from hardware.arrays import TickArray
from hardware.bus_spec import BusSpec
from hardware.servo import ServoSpec
from sim.emulator.conduct import Conduct
from sim.emulator.controller import EmulatedController
from sim.emulator.device import Device
from sim.emulator.fault_file import FaultPlan
from sim.emulator.fault_state import FaultState
from sim.emulator.line import Line
from sim.emulator.wire import Timing
from sim.emulator.workshop import devices_of


def robot_lines(
    servos: Sequence[ServoSpec],
    buses: Sequence[BusSpec],
    *,
    start: TickArray,
    now: float,
    plan: FaultPlan | None = None,
    seed: int = 0,
    timing: Timing | None = None,
    conduct: Conduct | None = None,
    powered: bool = False,
) -> dict[str, Line]:
    """A line for each bus, by its name. start: ticks (n,), in the order of `servos`; now: s, from which faults count.

    Servos are set up as the profile says; ids that no servo has are controllers such as the OpenCR of an OP3. powered:
    whether the one with the power switch has it on at first. conduct: None: the usual. Raises HardwareError for what
    a model cannot be.
    """
    ways = conduct or Conduct()
    devices = devices_of(
        servos,
        protocols={bus.name: bus.protocol for bus in buses},
        bauds={bus.name: bus.baud for bus in buses},
        return_delays={bus.name: bus.return_delay_value for bus in buses},
        start=start,
        seed=seed,
        now=now,
        conduct=ways,
    )
    lines = {}
    for bus in buses:
        own = [device for device, servo in zip(devices, servos, strict=True) if servo.bus == bus.name]
        taken = {device.id for device in own}
        others: list[Device] = []
        for device in bus.ids:
            if device not in taken:
                switches = bus.power is not None and bus.power.id == device
                on = powered or not switches
                others.append(EmulatedController(own if switches else (), id=device, baud=bus.baud, now=now, on=on))
        everyone = [*own, *others]
        faults = () if plan is None else plan.of_bus(bus.name)
        origin_seed = f"{seed if plan is None else plan.seed} {bus.name}"
        state = FaultState(everyone, faults=faults, origin=now, seed=origin_seed)
        lines[bus.name] = Line(
            everyone,
            baud=bus.baud,
            timing=timing,
            gaps=ways.gaps,
            fed_by=ways.fed_by,
            answers_damage=ways.answers_damage,
            faults=state,
            seed=seed,
        )
    return lines
