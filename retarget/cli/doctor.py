"""`retarget doctor`: find faults of a stream, a servo port or this machine, each with a next step."""

import json
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Any

import typer

from hardware.clock import Clock, MonotonicClock, VirtualClock
from retarget.cli.application import log
from retarget.cli.exit import echo
from retarget.errors import UsageError
from retarget.live.address import StreamAddress, is_address
from retarget.schema.files import write_atomic
from retarget.setup.doctor_machine import DoctorFinding, FindingLevel

LISTEN_S = 5.0
"""Usual time, s, to listen to a stream: over a hundred poses of the slowest sender."""
LONGEST_S = 600.0
"""Longest time, s, of `--seconds`, and of a recording."""


def doctor(
    target: str | None = None,
    performer: str | None = None,
    robot: str | None = None,
    seconds: float | None = None,
    tilt: bool = False,
    file: Path | None = None,
) -> None:
    """Say what is wrong with a stream, a servo port or this machine, and what to do.

    Nothing is moved, and no servo is asked but with --tilt. Exit code 0: nothing is wrong; 1: something is to be fixed;
    2: a bad argument.

    Arguments:
        target [ADDRESS|PORT]: A stream (vmc://:39539, natnet://HOST, ...) or a servo port; without: this machine.

    Options:
        performer NAME|FILE: The sensors that the stream should send; five if not given.
        robot NAME|PATH: Look at the servo ports of this robot.
        tilt: Tilt the robot by hand: do the signs of its IMU agree?
        seconds S: Time to listen; 5 if not given, for a recording all of it.
        file (--json) FILE: Write the findings as well.
    """
    _check(target, performer=performer, robot=robot, seconds=seconds)
    if target is not None and is_address(target):
        found = _stream(target, performer, seconds)
    elif tilt:
        found = _tilt(robot)
    elif target is not None or robot is not None:
        found = _ports(target, robot)
    else:
        found = _machine()
    for finding in found:
        echo(finding.render())
    wrong = sum(finding.level is FindingLevel.FIX for finding in found)
    echo("nothing is wrong" if not wrong else f"{wrong} to fix")
    if file is not None:
        text = json.dumps({"findings": [asdict(finding) for finding in found]}, indent=2, ensure_ascii=False)
        write_atomic(file, f"{text}\n".encode(), option="--json")
    raise typer.Exit(1 if wrong else 0)


def _check(target: str | None, *, performer: str | None, robot: str | None, seconds: float | None) -> None:
    is_stream = target is not None and is_address(target)
    if target is not None and robot is not None:
        step = "Leave one out"
        raise UsageError("the ports of a robot, or something else", where="--robot", found=target[:200], next_step=step)
    if not is_stream:
        for option, value in (("--performer", performer), ("--seconds", seconds)):
            if value is not None:
                raise UsageError("only a stream has this", where=option, next_step="Add its address: vmc://:39539")
    if seconds is not None and not (isfinite(seconds) and 0.0 < seconds <= LONGEST_S):
        raise UsageError("no such time", where="--seconds", found=seconds, allowed=f"above 0, to {LONGEST_S:g}")
    if target is not None and not is_stream and not target.startswith(("/", "./", "../")) and not Path(target).exists():
        allowed = "an address (vmc://:39539), or the path of a port (/dev/ttyUSB0); a robot's with --robot NAME"
        raise UsageError("neither a stream nor a port", where=target[:200] or "an empty word", allowed=allowed)


def _stream(text: str, name: str | None, seconds: float | None) -> list[DoctorFinding]:
    from retarget.live.address import parse_address
    from retarget.schema.performer import load_performer
    from retarget.setup.doctor_stream import stream_findings

    address = parse_address(text)
    if address.kind == "web":
        return _page(address, name or "web", LISTEN_S if seconds is None else seconds)
    performer = load_performer(name or "five")
    recorded = address.kind == "replay"
    clock: Clock = VirtualClock() if recorded else MonotonicClock()
    listen = (LONGEST_S if recorded else LISTEN_S) if seconds is None else seconds
    if not recorded:
        echo(f"listening for {listen:g} s: move every sensor, walk and turn", err=True)
    return stream_findings(address, performer, clock=clock, seconds=listen)


def _page(address: StreamAddress, name: str, seconds: float) -> list[DoctorFinding]:
    from retarget.cli.web.control import PageControl, opened_web
    from retarget.schema.performer import load_performer
    from retarget.setup.doctor_stream import web_findings

    performer, clock = load_performer(name), MonotonicClock()
    with opened_web(address, "doctor", notify=log) as (feed, receiver):
        control = PageControl(feed, log)

        def health() -> list[dict[str, Any]]:
            control.look()
            return [*control.health]

        return web_findings(address, performer, receiver, health, clock=clock, seconds=seconds)


def _ports(path: str | None, robot: str | None) -> list[DoctorFinding]:
    from retarget.setup.doctor_machine import port_findings

    if robot is None:
        return port_findings(path or "")
    from retarget.model.robot import load_uncalibrated

    buses = load_uncalibrated(robot).profile.bus_specs()
    return [finding for bus in buses for finding in port_findings(bus.port, baud=bus.baud)]


def _tilt(robot: str | None) -> list[DoctorFinding]:
    from retarget.cli.servo.places import Only, Where, find_places, imu_of, look_at, opened
    from retarget.setup.doctor_imu import tilt_findings

    if robot is None:
        raise UsageError("whose IMU is not known", where="--tilt", allowed="--tilt with --robot NAME")
    lacking = [finding for finding in _ports(None, robot) if finding.level is FindingLevel.FIX]
    if lacking:
        return lacking
    where, clock = Where(robot=robot), MonotonicClock()
    places = find_places(where, clock=clock)

    def prompt(text: str) -> None:
        input(f"{text}. Press Enter when you begin: ")

    with opened(places):
        imu = imu_of(where, [one.line for one in look_at(places, Only())], clock)
        if imu is None:
            raise UsageError(
                "the robot has no IMU", where="--tilt", found=robot, next_step="Write imu into its profile"
            )
        try:
            imu.open()
            return tilt_findings(lambda: imu.sample(clock.now()), clock.sleep_until, clock.now, prompt)
        finally:
            imu.close()


def _machine() -> list[DoctorFinding]:
    from retarget.setup.doctor_machine import (
        frame_findings,
        lateness_finding,
        machine_findings,
        python_findings,
        serial_findings,
    )

    machine = [*machine_findings(), lateness_finding(MonotonicClock()), *serial_findings()]
    return [*python_findings(), *frame_findings(), *machine]
