"""What a run is asked to be, about its bus."""

from dataclasses import replace
from pathlib import Path

import pytest

from messages import refuses
from retarget.errors import UsageError
from retarget.model.robot import load_robot
from retarget.run.options import PhysicsOptions, RunOptions, name_with_mass, priority_names


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


@pytest.mark.parametrize(
    ("bus", "has_mass"),
    [("mock", False), ("emulator", False), ("physics", True), ("profile", True), ("/dev/ttyUSB0", True)],
)
def test_a_robot_with_mass_goes_to_rest_before_torque_goes_off(bus: str, has_mass: bool) -> None:
    assert RunOptions(robot="op3", bus=bus).has_mass is has_mass


@pytest.mark.parametrize(
    ("values", "option", "hint"),
    [
        ({"mount": "gantri"}, "--mount", "gantry"),
        ({"perturbations": ("pusch",)}, "--perturb", "push"),
        ({"perturbations": ("mass", "mass=1.1")}, "--perturb", "Name each once"),
        ({"perturbations": ("push=3",)}, "--perturb", "push alone"),
        ({"perturbations": ("stiffness=0",)}, "--perturb", "stiffness=0.1"),
        ({"perturbations": ("stiffness=nan",)}, "--perturb", "stiffness=0.1"),
        ({"perturbations": ("stiffness=",)}, "--perturb", "stiffness=0.1"),
        ({"seed": -1}, "--seed", "0 to 4294967295"),
        ({"mount": "floor", "hook": "neck"}, "--hook", "only a gantry"),
    ],
)
def test_what_cannot_be_meant(values: dict[str, object], option: str, hint: str) -> None:
    with pytest.raises(UsageError) as caught:
        PhysicsOptions(**values)  # type: ignore[arg-type]
    assert option in str(caught.value) and hint in str(caught.value)


@pytest.mark.parametrize("bus", ["mock", "emulator", "none", "profile"])
@pytest.mark.parametrize(
    "physics", [PhysicsOptions(mount="stand"), PhysicsOptions(seed=1), PhysicsOptions(perturbations=("mass",))]
)
def test_they_are_refused_where_nothing_has_mass(bus: str, physics: PhysicsOptions) -> None:
    with refuses(UsageError, "--bus", "physics"):
        RunOptions(robot="op3", bus=bus, physics=physics)
    for simulated in ("physics", "physics+wire"):
        options = RunOptions(robot="op3", bus=simulated, physics=physics)
        assert options.has_physics and options.simulated


@pytest.mark.parametrize(("name", "usual"), [("toddlerbot", "balanced_sustained"), ("op3", "balanced")])
def test_a_profile_names_the_priorities_of_a_robot_with_mass(name: str, usual: str) -> None:
    robot = load_robot(name)
    for bus in ("physics", "physics+wire", "profile", "/dev/ttyUSB0"):
        assert priority_names(robot, RunOptions(robot=name, bus=bus))[-1] == usual
        assert priority_names(robot, RunOptions(robot=name, bus=bus, priorities="paper"))[-1] == "paper"
    for bus in ("mock", "emulator"):
        assert priority_names(robot, RunOptions(robot=name, bus=bus))[-1] == "servo"


def test_only_the_priorities_that_look_at_no_motion_are_replaced() -> None:
    def named(retarget: str, *, standing: str | None, hangs: bool) -> str:
        robot = load_robot("op3", root="suspended" if hangs else "free")
        profile = robot.profile.model_copy(update={"retarget": retarget, "standing": standing})
        return name_with_mass(replace(robot, profile=profile))

    assert named("servo", standing=None, hangs=False) == "balanced"
    assert named("servo", standing=None, hangs=True) == "fixed_base"
    assert named("mine", standing=None, hangs=False) == named("mine", standing=None, hangs=True) == "mine"
    assert named("mine", standing="balanced_sustained", hangs=False) == "balanced_sustained"
    assert named("mine", standing="balanced_sustained", hangs=True) == "mine"
