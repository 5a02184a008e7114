"""What a run with physics is asked to be."""

import pytest

from retarget.errors import UsageError
from retarget.options import RunOptions
from retarget.physics_options import MOUNTS, TROUBLES, PhysicsOptions
from retarget.robot_body import load_robot
from sim.physics.mount import Support
from sim.physics.perturbation import Trouble
from support.messages import refuses


def test_the_names_are_those_of_the_simulation() -> None:
    assert set(MOUNTS) == {support.value for support in Support}
    assert set(TROUBLES) == {trouble.value for trouble in Trouble}


@pytest.mark.parametrize(
    ("values", "option", "hint"),
    [
        ({"mount": "gantri"}, "--mount", "gantry"),
        ({"trouble": ("pusch",)}, "--trouble", "push"),
        ({"trouble": ("push", "push")}, "--trouble", "Name each once"),
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
    "physics", [PhysicsOptions(mount="stand"), PhysicsOptions(seed=1), PhysicsOptions(trouble=("mass",))]
)
def test_they_are_refused_where_nothing_has_mass(bus: str, physics: PhysicsOptions) -> None:
    with refuses(UsageError, "--bus", "physics"):
        RunOptions(robot="op3", bus=bus, physics=physics)
    for simulated in ("physics", "physics+wire"):
        options = RunOptions(robot="op3", bus=simulated, physics=physics)
        assert options.has_physics and options.simulated


def test_what_it_is_on_says_how_it_follows() -> None:
    assert RunOptions(robot="op3", bus="physics").root is None
    options = RunOptions(robot="op3", bus="physics", physics=PhysicsOptions(mount="gantry", hook="neck"))
    robot = load_robot("op3", root=options.root)
    assert robot.profile.root == "suspended" and not robot.stands
    assert robot.body.nq == load_robot("op3").body.nq - 7
