"""`retarget servo monitor`: a live table of all servos, which writes nothing."""

import math
from typing import Literal

from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from hardware.bus import ServoStates
from hardware.clock import Clock, MonotonicClock, VirtualClock
from hardware.dynamixel.bus import BusWatch
from hardware.dynamixel.checks import alert_text
from hardware.dynamixel.readings import ReportedTorque
from hardware.imu import ImuSample
from hardware.servo import ServoSpec
from retarget.cli.application import console
from retarget.cli.exit import echo, stop_on_signals
from retarget.cli.servo.places import EMULATOR, Only, Where, find_places, ids_of, imu_of, look_at, opened
from retarget.errors import UsageError

FIRST = 5
"""Cycles before one table is printed."""
DRAWN = 5.0
"""[Hz] Tables on a terminal."""
TORQUE = {
    ReportedTorque.UNKNOWN: "?",
    ReportedTorque.OFF: "off",
    ReportedTorque.ON: "on",
    ReportedTorque.HELD: "on, stopped by its watchdog",
}


def monitor(
    where: Where, only: Only, ids: str = "", rate: float = 50.0, once: bool = False, dry_run: bool = False
) -> None:
    """Show the state of all servos, until Ctrl-C: nothing is written, and torque stays as it is.

    Options:
        ids 1,2,5-9: Only these ids.
        rate HZ: Cycles per second.
        once: One table, as in a pipe.
    """
    if not 1.0 <= rate <= 500.0:
        raise UsageError("an impossible rate", where="--rate", found=f"{rate:g}", allowed="1 to 500 Hz")
    selected = ids_of(ids)
    screen = console()
    once = once or not screen.is_terminal
    clock: Clock = VirtualClock() if once and where.port == EMULATOR else MonotonicClock()
    places = find_places(where, clock=clock)
    if dry_run:
        echo(f"would read all servos of {', '.join(one.where for one in places)}; nothing is written")
        return
    with opened(places):
        lines = [one.line for one in look_at(places, only, ids=selected) if one.line.servos]
        placed = {line.index_of[device]: servo for line in lines for device, servo in line.servos.items()}
        servos = [placed[index] for index in sorted(placed)]
        imu = imu_of(where, lines, clock)
        if imu is not None:
            imu.open()
        watch = BusWatch(lines, imu)
        if once:
            for _ in range(FIRST):
                states = watch.read()
                clock.sleep_until(states.time + 1.0 / rate)
            screen.print(shown(servos, states, watch, rate))
            return
        drawn = -math.inf
        with stop_on_signals() as stop, Live(console=screen, auto_refresh=False) as live:
            due = clock.now()
            while not stop():
                states = watch.read()
                if states.time >= drawn + 1.0 / DRAWN:
                    drawn = states.time
                    live.update(shown(servos, states, watch, rate), refresh=True)
                due = max(due + 1.0 / rate, clock.now())
                clock.sleep_until(due)


def shown(servos: list[ServoSpec], states: ServoStates, watch: BusWatch, rate: float) -> Group:
    """The table of all servos, and a line about the cycles."""
    table = Table(box=None, pad_edge=False)
    # A narrow terminal cuts numbers, but not names.
    whole = {"joint": max((len(servo.joint) for servo in servos), default=0), "torque": len("torque")}
    for heading in ("joint", "id", "ticks", "deg", "A", "C", "V", "torque", "age, s", "lost", "errors"):
        justify: Literal["left", "right"] = "left" if heading in ("joint", "errors") else "right"
        table.add_column(heading, justify=justify, min_width=whole.get(heading))
    for at, servo in enumerate(servos):
        angle = math.degrees((int(states.position[at]) - servo.zero_tick) / servo.ticks_per_rad)
        answered = math.isfinite(states.age[at])
        values = (f"{states.position[at]}", f"{angle:.1f}") if answered else ("-", "-")
        table.add_row(
            servo.joint,
            str(servo.id),
            *values,
            _number(states.current[at], 3),
            _number(states.temperature[at], 0),
            _number(states.voltage[at], 1),
            TORQUE[watch.torque[at]],
            f"{states.age[at]:.1f}" if answered else "never",
            str(watch.losses[at]),
            alert_text(int(states.alert[at])) if states.alert[at] else "",
        )
    low, high = watch.times()
    imu = [] if states.imu is None else [Text(imu_line(states.imu))]
    line = f"cycle p50 {1e3 * low:.2f} ms, p99 {1e3 * high:.2f} ms; {rate:g} Hz requested; {watch.retries} retries"
    return Group(table, *imu, Text(line))


def imu_line(imu: ImuSample) -> str:
    """The reading of the IMU, in words."""
    if not math.isfinite(imu.age):
        return "IMU: no answer"
    roll, pitch = map(math.degrees, imu.tilt)
    turn, force = (", ".join(f"{one:.2f}" for one in values) for values in (imu.angular_velocity, imu.acceleration))
    old = "" if imu.valid else f"; not valid, {imu.age:.2f} s old"
    tilt = f"{roll:+.1f} degrees to the right, {pitch:+.1f} forward"
    return f"IMU: {tilt}; turns {turn} rad/s; acceleration {force} m/s^2{old}"


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"
