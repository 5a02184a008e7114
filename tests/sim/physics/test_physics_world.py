"""The world: masses, soles and shapes, mounts, fixtures, and what it refuses."""

import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from messages import refuses
from physics_rig import PhysicsRig, op3, standing
from retarget.errors import ConfigError
from retarget.ik.support_polygon import support_distance, support_edges
from retarget.model.robot import RobotBody, load_robot
from sim.buses import simulation_of
from sim.physics.ground import MAX_CORNERS, SOLE, sole_corners
from sim.physics.mount import Mount, Support, mount_of
from sim.physics.perturbation import Perturbation, Push
from sim.physics.state import StateReader

HOOK = "neck"


def changed(**update: Any) -> RobotBody:
    return replace(op3(), profile=op3().profile.model_copy(update=update))


def test_it_weighs_what_the_body_file_says_and_masses_can_be_scaled_and_moved() -> None:
    offset = (0.01, -0.004, 0.002)
    changes = [Perturbation(mass_scale=scale) for scale in (1.0, 0.9, 1.1)] + [Perturbation(com_offset=offset)]
    made = [simulation_of(op3(), start=standing(), perturbation=change) for change in changes]
    weights = [simulation.world.weight for simulation in made]
    assert weights == pytest.approx([share * 9.81 * 3.14747 for share in (1.0, 0.9, 1.1, 1.0)], rel=1e-4)
    assert [drive.servo.joint for drive in made[0].world.drives] == list(op3().joint_map.joints)
    root = made[0].world.root
    moved = made[3].data.subtree_com[root] - made[0].data.subtree_com[root]
    assert moved.tolist() == pytest.approx(list(offset), abs=1e-6)


@pytest.mark.parametrize(("share", "slides"), [(0.7, False), (1.3, True)])
def test_soles_slide_beyond_the_friction_of_the_floor(share: float, slides: bool) -> None:
    friction = 0.2
    force = share * friction * 30.9 / 2.0  # N on each foot
    pushes = tuple(Push((force, 0.0, 0.0), 0.8, 0.5, frame) for frame in ("l_ankle", "r_ankle"))
    rig = PhysicsRig(perturbation=Perturbation(friction=friction, pushes=pushes))
    rig.arm()
    rig.run(1.3)
    assert (rig.bus.witness.log.slip_m > 5e-3).all() == slides
    assert slides or (rig.bus.witness.log.slip_m < 5e-4).all()


def test_soles_touch_where_their_polygons_end() -> None:
    polygon = np.array(op3().profile.feet["left"].polygon)
    corners = sole_corners(polygon)
    assert len(corners) == MAX_CORNERS
    lost = -support_distance(polygon, support_edges([corners]))
    assert 0.0 <= lost.max() < 0.006  # m
    square = polygon[[1, 2, 5, 6]]
    assert sole_corners(square) is square


def test_shapes_of_the_feet_do_not_see_the_floor_and_soles_see_nothing_else() -> None:
    model = simulation_of(op3(), start=standing()).world.model
    floor = model.geom("physics_floor")
    for index in range(model.ngeom):
        geom = model.geom(index)
        sees = bool(geom.conaffinity[0] & floor.contype[0])
        if geom.name.startswith(SOLE):
            assert sees and not geom.contype[0]
        elif geom.name != "physics_floor":
            assert sees is ("foot" not in geom.name)


def test_on_a_stand_it_keeps_its_root_and_never_falls() -> None:
    rig = PhysicsRig(mount=Mount(Support.STAND))
    rig.arm()
    states = rig.run(1.0)
    assert rig.bus.witness.fall is None and not rig.bus.witness.state.load.any()
    assert rig.error(states) < 0.03
    assert not np.ptp(rig.bus.witness.log.column("root"), axis=0).any()
    assert rig.bus.witness.state.sole[:, 2].min() > 0.04


def test_on_a_gantry_it_hangs_below_its_hook() -> None:
    rig = PhysicsRig(mount=Mount(Support.GANTRY, hook=HOOK))
    rig.arm()
    rig.run(3.0)
    state = rig.bus.witness.state
    assert rig.bus.witness.fall is None and not state.load.any() and not state.touching
    height = rig.bus.witness.log.column("root")[:, 2]
    assert np.ptp(height[200:]) < 5e-3
    neck = op3().points(state.q[None], (HOOK,))[0, 0]
    assert neck[:2].tolist() == pytest.approx(state.com[:2].tolist(), abs=3e-3)
    assert state.sole[:, 2].min() > 0.02


@pytest.mark.parametrize("root", ["fixed", "suspended"])
def test_legs_of_a_robot_whose_profile_holds_it_do_not_meet_the_floor(root: str, tmp_path: Path) -> None:
    """OP3's body file has its root where its soles, legs bent, are 10 mm over the floor."""
    shutil.copytree(op3().profile.path.parent, tmp_path / "held")
    profile = tmp_path / "held" / "robot.yaml"
    profile.write_text(profile.read_text().replace("root: free", f"root: {root}"))
    held = load_robot(profile)
    simulation = simulation_of(held, start=standing(), mount=replace(mount_of(held), hook="neck"))
    soles = StateReader(simulation).read().sole
    assert soles[:, 2].min() == pytest.approx(0.2, abs=2e-3)


def test_a_robot_without_feet_or_gains_is_refused() -> None:
    with refuses(ConfigError):
        simulation_of(changed(feet={}), start=standing())
    servos = [replace(servo, gains=type(servo.gains)()) for servo in op3().joint_map.servos]
    robot = replace(op3(), joint_map=type(op3().joint_map)(servos))
    with refuses(ConfigError, 20, "r_sho_pitch"):
        simulation_of(robot, start=standing())


def test_a_missing_engine_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, start = op3(), standing()
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for start_of_it in (lambda: simulation_of(robot, start=start), lambda: load_robot("op3")):
        with refuses(ConfigError, "MuJoCo"):
            start_of_it()
