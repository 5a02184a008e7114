"""Which servo, and on which bus: by joint, by id, by port."""

import re
from dataclasses import replace

import pytest

from hardware.dynamixel.checks import needed_ticks
from hardware.dynamixel.settings import SetupRequest
from hardware.joint_map import JointMap
from messages import refuses
from retarget.cli.servo import places
from retarget.cli.servo.places import Where, find_places, find_target
from retarget.cli.servo.setup import check_settings
from retarget.errors import UsageError
from retarget.model.robot import RobotBody, load_uncalibrated

MAIN, HEAD = "/dev/ttyUSB0", "/dev/head"


@pytest.fixture
def divided(monkeypatch: pytest.MonkeyPatch) -> RobotBody:
    """An OP3 with its head on a second bus, where head_pan has the id of r_sho_pitch."""
    robot = load_uncalibrated("op3")
    main = robot.profile.buses["main"]
    buses = {"main": main, "head": main.model_copy(update={"port": HEAD, "ids": (1, 20), "power": None})}
    servos = tuple(
        replace(one, bus="head", id={19: 1}.get(one.id, one.id)) if one.id in (19, 20) else one
        for one in robot.joint_map.servos
    )
    profile = robot.profile.model_copy(update={"buses": buses})
    body = replace(robot, profile=profile, joint_map=JointMap(servos))
    for name in ("load_uncalibrated", "load_robot"):
        monkeypatch.setattr(places, name, lambda name: body)
    return body


@pytest.mark.parametrize(
    ("port", "joint", "device", "found"),
    [
        (None, "head_pan", None, (HEAD, "head", 1)),
        (None, "head_pan", 57, (HEAD, "head", 57)),
        ("/dev/else", "head_pan", None, ("/dev/else", "head", 1)),
        (None, "r_knee", None, (MAIN, "main", 13)),
        (None, None, 20, (HEAD, "head", 20)),
        ("/dev/else", None, 20, ("/dev/else", "head", 20)),
        (HEAD, None, 1, (HEAD, "head", 1)),
        (MAIN, None, 1, (MAIN, "main", 1)),
    ],
)
def test_the_bus_is_found(
    port: str | None, joint: str | None, device: int | None, found: tuple[str, str, int], divided: RobotBody
) -> None:
    one = find_target(Where("op3", port), joint, device)
    assert one.place.spec is not None and one.servo is not None
    assert (one.place.port.name, one.place.spec.name, one.device) == found
    assert one.servo.bus == found[1] and (joint is None or one.servo.joint == joint)
    assert one.needed == needed_ticks(divided.joint_map)[one.servo.joint]


@pytest.mark.parametrize(
    ("robot", "port", "joint", "device", "text"),
    [
        ("op3", None, None, 1, "several servos have this id; found 1: r_sho_pitch (bus main), head_pan (bus head)"),
        ("op3", "/dev/else", None, 1, "allowed: --joint NAME"),
        ("op3", None, "r_kne", None, "Did you mean r_knee"),
        ("op3", None, None, None, "--joint NAME"),
        ("op3", None, None, 99, "which bus"),
        ("op3", "/dev/else", None, 99, f"allowed: {MAIN} (bus main), {HEAD} (bus head)"),
        (None, "/dev/else", "r_knee", 1, "--robot NAME beside it"),
        (None, "/dev/else", None, None, "which servo"),
    ],
)
def test_what_names_no_servo_is_refused_with_the_way_out(
    robot: str | None, port: str | None, joint: str | None, device: int | None, text: str, divided: RobotBody
) -> None:
    with pytest.raises(UsageError, match=re.escape(text)):
        find_target(Where(robot, port), joint, device)


def test_a_port_of_the_profile_means_its_bus(divided: RobotBody) -> None:
    assert [one.spec.name for one in find_places(Where("op3", HEAD)) if one.spec] == ["head"]
    assert len(find_places(Where("op3"))) == 2
    with refuses(UsageError):
        find_places(Where("op3", "/dev/else"))


X, AX = "XM430-W350", "AX-12A"


@pytest.mark.parametrize(
    ("settings", "protocol", "model", "text"),
    [
        (SetupRequest(new_id=254), None, None, "servo setup: no such id for this servo; found 254; allowed: 0 to 252"),
        (SetupRequest(new_id=-1), None, X, "found -1"),
        (SetupRequest(return_delay=3e-6), None, None, "no such return delay for this servo; found 3 us"),
        (SetupRequest(return_delay=510e-6), 2, X, "allowed: 0 to 508 us, even"),
        (SetupRequest(return_delay=float("nan")), 2, X, "found nan us"),
        (SetupRequest(baud=77), None, None, "--baud: no such speed"),
        (SetupRequest(baud=4_500_000), 1, None, "--baud: no such speed"),
        (SetupRequest(baud=4_500_000), 2, "XL330-M288", "no such baud rate for this servo"),
        (SetupRequest(registers={"drive_mode": 300}), None, None, "no such drive_mode for this servo; found 300"),
        (SetupRequest(registers={"drive_mode": -1}), 2, X, "found -1"),
        (SetupRequest(registers={"drive_mode": 0}), 1, AX, "no such register; found 'drive_mode'"),
        (SetupRequest(registers={"goal_position": 1}), None, None, "no such register for this servo; found goal_pos"),
        (SetupRequest(registers={"protocol_type": 1}), 2, X, "no such register for this servo"),
        (SetupRequest(registers={"max_position_limit": 4096}), 2, X, "allowed: 0 to 4095"),
        (SetupRequest(registers={"baud_rate": 1}), 2, X, "found baud_rate; allowed: the option --baud"),
        (SetupRequest(registers={"status_return_level": 1}), 2, X, "no such register for this servo"),
    ],
)
def test_refused(settings: SetupRequest, protocol: int | None, model: str | None, text: str) -> None:
    with pytest.raises(UsageError, match=re.escape(text)):
        check_settings(settings, protocol, model)
