"""What a run is asked to be, about its bus."""

from pathlib import Path

import pytest

from retarget.errors import UsageError
from retarget.options import RunOptions
from support.messages import refuses


@pytest.mark.parametrize("bus", ["mock", "none", "profile", "/dev/ttyUSB0"])
def test_faults_are_the_emulator_s(bus: str) -> None:
    with refuses(UsageError):
        RunOptions(robot="op3", bus=bus, faults=Path("faults.yaml"))
    assert RunOptions(robot="op3", bus="emulator", faults=Path("faults.yaml")).simulated


@pytest.mark.parametrize("bus", ["profile", "/dev/ttyUSB0", "./link"])
def test_real_servos_are_never_moved_without_the_gate(bus: str) -> None:
    assert not RunOptions(robot="op3", bus=bus).simulated
    with refuses(UsageError):
        RunOptions(robot="op3", bus=bus, gate=False)


@pytest.mark.parametrize("bus", ["emulater", "ttyUSB0", "COM3", ""])
def test_a_bus_that_nobody_knows_is_refused(bus: str) -> None:
    with refuses(UsageError):
        RunOptions(robot="op3", bus=bus)


@pytest.mark.parametrize(
    ("bus", "has_mass"),
    [("mock", False), ("emulator", False), ("physics", True), ("profile", True), ("/dev/ttyUSB0", True)],
)
def test_whatever_falls_without_torque_is_parked_first(bus: str, has_mass: bool) -> None:
    assert RunOptions(robot="op3", bus=bus).has_mass is has_mass
