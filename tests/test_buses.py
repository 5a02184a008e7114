"""From the name of a bus to the bus."""

from dataclasses import replace

import numpy as np
import pytest

from hardware.clock import VirtualClock
from hardware.dynamixel.bus import DynamixelBus
from hardware.errors import BusError
from retarget.cli.buses import make_bus, standing_ticks
from retarget.errors import UsageError
from retarget.robot_body import RobotBody, load_robot
from sim.mock_bus import MockBus
from sim.no_bus import NoBus
from support.messages import refuses


@pytest.fixture(scope="module")
def robot() -> RobotBody:
    return load_robot("op3")


@pytest.fixture
def divided(robot: RobotBody) -> RobotBody:
    """The same with its head on a second bus."""
    main = robot.profile.buses["main"]
    buses = {"main": main, "head": main.model_copy(update={"port": "/dev/head", "ids": (19, 20), "power": None})}
    servos = {
        joint: servo.model_copy(update={"bus": "head" if servo.id in (19, 20) else "main"})
        for joint, servo in robot.profile.servos.items()
    }
    return replace(robot, profile=robot.profile.model_copy(update={"buses": buses, "servos": servos}))


@pytest.mark.parametrize(("name", "kind"), [("mock", MockBus), ("none", NoBus), ("emulator", DynamixelBus)])
def test_simulated_servos_begin_where_the_robot_stands(name: str, kind: type, robot: RobotBody) -> None:
    bus = make_bus(name, robot, VirtualClock())
    assert isinstance(bus, kind)
    bus.open()
    assert np.array_equal(bus.read().position, standing_ticks(robot))
    bus.close()


@pytest.mark.parametrize(("name", "port"), [("profile", "/dev/ttyUSB0"), ("/dev/ttyUSB7", "/dev/ttyUSB7")])
def test_a_real_bus_is_on_the_profile_s_port_or_on_the_named_one(name: str, port: str, robot: RobotBody) -> None:
    bus = make_bus(name, robot, VirtualClock())
    assert isinstance(bus, DynamixelBus)
    assert [(line.port.name, line.spec.port) for line in bus.lines] == [(port, port)]


def test_no_port_is_touched_before_it_is_opened(robot: RobotBody) -> None:
    bus = make_bus("/dev/no-such-port", robot, VirtualClock())
    with refuses(BusError):
        bus.open()


def test_one_port_for_several_buses_is_refused(divided: RobotBody) -> None:
    with refuses(UsageError) as caught:
        make_bus("/dev/ttyUSB7", divided, VirtualClock())
    for text in ("--bus", "/dev/ttyUSB7", "main, head", "into the profile"):
        assert text in str(caught.value)
    bus = make_bus("profile", divided, VirtualClock())
    assert isinstance(bus, DynamixelBus)
    assert bus.lines[0].port.name == "/dev/ttyUSB0"


def test_what_is_worth_a_note_goes_to_stderr(robot: RobotBody, capsys: pytest.CaptureFixture[str]) -> None:
    bus = make_bus("profile", robot, VirtualClock())
    assert isinstance(bus, DynamixelBus)
    bus._tell("something")
    assert capsys.readouterr() == ("", "note: something\n")
