"""`retarget servo setup`: write id, speed and other EEPROM settings of one servo, or of all, one by one."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from hardware.dynamixel.codec import MAX_ID
from hardware.dynamixel.control_table import tables
from hardware.dynamixel.found_servos import LEVEL
from hardware.dynamixel.settings import ANSWER_ALL, SetupRequest, settings_of
from hardware.errors import HardwareError
from retarget.cli.servo.places import ServoTarget, Where, check_speed, find_target, opened
from retarget.cli.servo.setup_all import set_up_all
from retarget.cli.servo.write_settings import find_one, set_up
from retarget.errors import UsageError


def registers_of(words: Sequence[str]) -> dict[str, int]:
    """Registers and values of NAME=VALUE words. Raises UsageError."""
    found = {}
    for word in words:
        name, _, value = word.partition("=")
        try:
            found[name.strip()] = int(value, 0)
        except ValueError:
            raise UsageError(
                "this is no setting", where="--register", found=repr(word[:80]), allowed="NAME=VALUE"
            ) from None
    return found


def check_device(device: int, protocol: int | None) -> None:
    """Raise UsageError for an id that no servo has."""
    highest = MAX_ID + (protocol == 1)
    if not 0 <= device <= highest:
        raise UsageError(
            "no servo has this id", where="--id", found=device, allowed=f"0 to {highest}: 254 is the broadcast id"
        )


def check_settings(request: SetupRequest, protocol: int | None, model: str | None) -> None:
    """Raise UsageError for settings that no servo of this protocol and model (None: any) can hold."""
    check_speed(protocol, request.baud)
    if request.registers.get(LEVEL) == ANSWER_ALL:  # any servo can hold it
        request = replace(
            request, registers={name: request.registers[name] for name in request.registers if name != LEVEL}
        )
    possible = [one for one in tables() if protocol in (None, one.protocol) and model in (None, one.model)]
    if not possible:
        return
    refused = ""
    for table in [one for one in possible if all(map(one.has, request.registers))] or possible[:1]:
        try:
            settings_of(table, request)
        except HardwareError as error:
            refused = refused or str(error).removeprefix(f"{table.model}: ").removesuffix(".")
        else:
            return
    raise UsageError(refused, where="servo setup")


def setup(
    where: Where,
    joint: str | None = None,
    device: int | None = None,
    protocol: int | None = None,
    new_id: int | None = None,
    baud: int | None = None,
    return_delay: float | None = None,
    register: tuple[str, ...] = (),
    everything: bool = False,
    yes: bool = False,
    dry_run: bool = False,
) -> None:
    """Write settings into one servo, at whatever speed it is found. Each is read back; id and speed come last.

    With --robot and --joint (or --id of the profile) it gets everything in which it differs from the profile; --joint
    with --id makes the servo with that id the joint's own. Other options come before the profile. Shows what it has and
    what it gets, and asks. Ctrl-C ends it after the value that is being written.

    With --robot and --all it asks for the servos of the robot one after the other, each connected alone, and sets up
    each as it is found; those that are set up already are left out. Without --port it finds the port; --port emulator
    shows it without servos.

    Options:
        joint NAME: The servo of this joint of the robot.
        device (--id) N: Its id as it is.
        protocol 1|2: Only this protocol.
        new_id N: Its id as it is to be.
        baud BAUD: Its speed as it is to be.
        return_delay US: Pause before it answers, us.
        register NAME=VALUE: Any other of its EEPROM, as drive_mode=4.
        everything (--all): All servos of the robot, one after the other.
        dry_run: Read and show, write nothing.
    """
    if device is not None:
        check_device(device, protocol)
    request = SetupRequest(new_id, baud, None if return_delay is None else 1e-6 * return_delay, registers_of(register))
    if everything:
        _check_all(where, {"--joint": joint, "--id": device, "--new-id": new_id, "--protocol": protocol}, request)
        set_up_all(where, request, yes=yes, dry_run=dry_run)
        return
    target = find_target(where, joint, device)
    _check(target, request, protocol)
    place = target.place
    with opened([place]):
        set_up(target, request, find_one(place, target.device, protocol), yes=yes, dry_run=dry_run)


def _check_all(where: Where, options: Mapping[str, object], request: SetupRequest) -> None:
    if where.robot is None:
        raise UsageError("the servos of which robot", where="--all", allowed="--robot NAME beside it")
    given = ", ".join(option for option, value in options.items() if value is not None)
    if given:
        raise UsageError("only one servo can have this", where=given, found="--all", next_step="Leave one of them out")
    check_settings(request, None, None)


def _check(target: ServoTarget, request: SetupRequest, protocol: int | None) -> None:
    servo, spec = target.servo, target.place.spec
    if servo is None:
        check_settings(request, protocol, None)
        if spec is not None and request == SetupRequest():
            known = ", ".join(str(one.id) for _, one in target.place.servos)
            raise UsageError(
                "no servo of the profile has this id",
                where="--id",
                found=target.device,
                allowed=known,
                next_step="Say with --joint NAME whose servo it is to be",
            )
        return
    assert spec is not None
    check_settings(request, spec.protocol, servo.model.name)
