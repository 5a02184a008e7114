"""Which servo is meant: by its id on a port, or by its joint in a robot's profile, which tells the bus."""

from dataclasses import dataclass
from pathlib import Path

from hardware.bus_spec import BusSpec
from hardware.dynamixel.travel import Span, needed_ticks
from hardware.servo import ServoSpec
from retarget.cli.servo.places import Place, find_places
from retarget.errors import RetargetError, UsageError, suggest
from retarget.robot_body import RobotBody, load_robot, load_uncalibrated


@dataclass(frozen=True, eq=False)
class Target:
    """One servo. device: its id as it is; servo, needed: what the profile says of it, None without."""

    place: Place
    device: int
    servo: ServoSpec | None = None
    needed: Span | None = None


def find_target(
    robot: str | None, port: str | None, joint: str | None, device: int | None, faults: Path | None
) -> Target:
    """The servo that is meant; its port is not open. device: its id as it is, None: that of the profile.

    Raises UsageError where that names none, or several.
    """
    if robot is None:
        if joint is not None:
            raise UsageError("a joint of which robot", where="--joint", found=joint, allowed="--robot NAME beside it")
        if device is None:
            raise UsageError("which servo", where="servo setup", allowed="--id N, or --robot NAME --joint NAME")
        return Target(find_places(None, port, faults=faults)[0], device)
    body = load_uncalibrated(robot)
    servo = _servo(body, port, joint, device)
    places = find_places(robot, port, faults=faults, bus=None if servo is None else servo.bus)
    if len(places) != 1:
        names = ", ".join(place.where for place in places)
        raise UsageError("which bus", where="--robot", found=names, allowed="--joint NAME, or --port PATH of one")
    if servo is None:
        assert device is not None
        return Target(places[0], device)
    needed = needed_ticks(_calibrated(robot, body).joint_map.servos).get(servo.joint)
    return Target(places[0], servo.id if device is None else device, servo, needed)


def _servo(body: RobotBody, port: str | None, joint: str | None, device: int | None) -> ServoSpec | None:
    """The servo of the profile; None where only an id is named that the profile does not have."""
    servos = body.joint_map.servos
    if joint is not None:
        found = [one for one in servos if one.joint == joint]
        if not found:
            known = [one.joint for one in servos]
            step = suggest(joint, known)
            raise UsageError(
                "no such joint", where="--joint", found=repr(joint), allowed=", ".join(known), next_step=step
            )
        return found[0]
    if device is None:
        raise UsageError("which servo", where="servo setup", allowed="--joint NAME, or --id N of the profile")
    there = {bus.name for bus in _buses_at(body, port)}
    found = [one for one in servos if one.id == device and one.bus in there]
    if len(found) > 1:
        joints = ", ".join(f"{one.joint} (bus {one.bus})" for one in found)
        raise UsageError(
            "several servos have this id", where="--id", found=f"{device}: {joints}", allowed="--joint NAME"
        )
    return found[0] if found else None


def _buses_at(body: RobotBody, port: str | None) -> list[BusSpec]:
    """The buses of a port; all, where it is none of theirs."""
    buses = list(body.profile.bus_specs())
    return [bus for bus in buses if bus.port == port] or buses


def _calibrated(robot: str, body: RobotBody) -> RobotBody:
    """With the zero ticks of this specimen, where it has sound ones: what a joint needs depends on them."""
    try:
        return load_robot(robot)
    except RetargetError:
        return body
