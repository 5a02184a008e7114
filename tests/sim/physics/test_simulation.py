"""Soles that are held stay where they are, while the body above them moves and the engine would let them creep."""

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hardware.arrays import FloatArray
from messages import refuses
from physics_rig import PhysicsRig, op3, standing
from retarget.errors import ConfigError
from retarget.ik.support_polygon import support_distance, support_edges
from retarget.model.body_file import engine
from retarget.model.robot import load_robot
from sim.buses import simulation_of
from sim.physics.ground import MAX_CORNERS, SOLE, sole_corners
from sim.physics.mount import Mount, Support, mount_of
from sim.physics.perturbation import NOMINAL, Perturbation, PerturbationKind, Push, drawn
from sim.physics.simulation import Simulation, SoleSteps
from sim.physics.state import StateReader

SPEED = 4.0  # [rad/s]


def moving(seed: int) -> PhysicsRig:
    """An OP3 whose joints turn at speeds up to SPEED while its soles are still: those that move no contact."""
    rig = PhysicsRig()
    rig.arm()
    rig.run(1.5)
    data, model = rig.bus.witness.simulation.data, rig.bus.witness.simulation.world.model
    rows = (data.contact.efc_address[:, None] + np.arange(3)).ravel()
    jacobian = np.zeros((rows.size, model.nv))
    unit = np.eye(model.nv)
    for column in range(model.nv):  # rows are dense or sparse by the version of the engine
        data.qvel[:] = unit[column]
        engine().mj_fwdVelocity(model, data)
        jacobian[:, column] = data.efc_vel[rows]
    speeds = np.random.default_rng(seed).uniform(-1.0, 1.0, model.nv)
    speeds -= np.linalg.pinv(jacobian, rcond=1e-6) @ (jacobian @ speeds)
    data.qvel[:] = SPEED / np.abs(speeds[6:]).max() * speeds
    engine().mj_forward(model, data)
    assert np.abs(data.efc_vel[rows]).max() < 1e-5  # m/s
    return rig


def numeric(rig: PhysicsRig, contact: int) -> FloatArray:
    """Acceleration (3,) m/s^2 of what touches at a contact when no joint accelerates: its velocity's change along the
    speeds, by central differences."""
    simulation, mujoco = rig.bus.witness.simulation, engine()
    model, here = simulation.world.model, simulation.data
    body, step = int(model.geom_bodyid[here.contact.geom[contact, 1]]), 1e-5
    place = here.xmat[body].reshape(3, 3).T @ (here.contact.pos[contact] - here.xpos[body])
    velocities = []
    for side in (-1.0, 1.0):
        data = mujoco.MjData(model)
        data.qpos[:] = here.qpos
        mujoco.mj_integratePos(model, data.qpos, here.qvel, side * step)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, jacobian, None, data.xpos[body] + data.xmat[body].reshape(3, 3) @ place, body)
        velocities.append(jacobian @ here.qvel)
    return np.asarray((velocities[1] - velocities[0]) / (2.0 * step))


@pytest.mark.parametrize("seed", range(3))
def test_the_correction_is_the_derivative_of_the_jacobian(seed: int) -> None:
    rig = moving(seed)
    data, model = rig.bus.witness.simulation.data, rig.bus.witness.simulation.world.model
    engine().mj_step1(model, data)
    before = data.efc_aref.copy()
    SoleSteps(model, data)._correct(due=True)
    contact = data.contact
    assert len(contact.geom) >= 8
    for index, row in enumerate(contact.efc_address.tolist()):
        taken = before[row : row + 3] - data.efc_aref[row : row + 3]
        expected = contact.frame[index].reshape(3, 3) @ numeric(rig, index)
        assert np.abs(expected).max() > 0.01
        assert taken.tolist() == pytest.approx(expected.tolist(), abs=1e-4)
    data.qvel[:] = 0.0  # what does not move is not corrected
    engine().mj_step1(model, data)
    before = data.efc_aref.copy()
    SoleSteps(model, data)._correct(due=True)
    assert data.ncon >= 8 and data.efc_aref.tolist() == before.tolist()


def test_a_robot_in_the_air_moves_as_the_engine_says() -> None:
    ours, plain = (PhysicsRig(mount=Mount(Support.STAND), start=standing()) for _ in range(2))
    model, data = plain.bus.witness.simulation.world.model, plain.bus.witness.simulation.data
    for rig in (ours, plain):
        rig.arm()
    ours.bus.witness.simulation._steps.take(50)
    engine().mj_step(model, data, nstep=50)
    assert ours.bus.witness.simulation.data.qpos.tolist() == data.qpos.tolist()


def running() -> Simulation:
    simulation = simulation_of(op3(), start=standing())
    simulation.switch(np.ones(20, dtype=np.bool_))
    return simulation


def test_the_motion_is_the_same_in_steps_and_a_push_begins_and_ends_on_time() -> None:
    whole, cut = running(), running()
    whole.advance(0.008)
    for step in range(1, 5):
        cut.advance(0.002 * step)
    assert whole.data.qpos.tolist() == pytest.approx(cut.data.qpos.tolist(), abs=1e-5)
    simulation = running()
    simulation.push(Push((0.0, 2.0, 0.0), 0.01, 0.02, frame="neck"))
    simulation.advance(0.008)
    assert not simulation.data.xfrc_applied.any()
    simulation.advance(0.02)
    root = simulation.world.root
    assert simulation.data.xfrc_applied[root, :3].tolist() == [0.0, 2.0, 0.0]
    assert simulation.data.xfrc_applied[root, 3] < -0.1  # the neck is above the centre of mass
    simulation.advance(0.04)
    assert not simulation.data.xfrc_applied.any()


# Perturbations that chance draws: in their bounds, the same for the same seed.

WITHIN = (1.0, 8.0)


def test_what_is_drawn_is_as_large_as_stated_and_the_same_for_the_same_seed() -> None:
    def all_of(kind: PerturbationKind) -> list[Perturbation]:
        return [drawn(kind, seed, within=WITHIN, frame="neck") for seed in range(50)]

    for kind in PerturbationKind:
        cases = all_of(kind)
        assert cases == all_of(kind) and NOMINAL not in cases
        assert len({repr(case) for case in cases}) == (1 if kind is PerturbationKind.LATENCY else 50)
    masses = [case.mass_scale for case in all_of(PerturbationKind.MASS)]
    assert 0.9 <= min(masses) < 0.93 and 1.07 < max(masses) <= 1.1
    offsets = [case.com_offset[:2] for case in all_of(PerturbationKind.CENTRE_OF_MASS)]
    assert [float(np.hypot(*offset)) for offset in offsets] == pytest.approx([0.01] * 50)
    assert all(0.5 <= case.friction <= 1.0 for case in all_of(PerturbationKind.FRICTION))
    scales = [case.stiffness_scale for case in all_of(PerturbationKind.STIFFNESS)]
    assert 0.7 <= min(scales) < 0.75 and 1.25 < max(scales) <= 1.3
    assert {case.latency_s for case in all_of(PerturbationKind.LATENCY)} == {0.03}
    pushes = [case.pushes[0] for case in all_of(PerturbationKind.PUSH)]
    assert {push.force for push in pushes} == {(3.0, 0.0, 0.0), (-3.0, 0.0, 0.0), (0.0, 3.0, 0.0)}
    assert all(WITHIN[0] <= push.start <= WITHIN[1] and push.duration == 0.2 for push in pushes)
    assert {push.frame for push in pushes} == {"neck"}
    for kind in (PerturbationKind.STIFFNESS, PerturbationKind.FRICTION):
        given = {drawn(kind, seed, within=WITHIN, value=0.6) for seed in range(3)}
        assert len(given) == 1 and 0.6 in vars(given.pop()).values()


# The world: masses, soles and shapes, mounts, fixtures, refusals.


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


def test_soles_touch_the_floor_alone_where_their_polygons_end_and_feet_do_not() -> None:
    polygon = np.array(op3().profile.feet["left"].polygon)
    corners = sole_corners(polygon)
    assert len(corners) == MAX_CORNERS
    lost = -support_distance(polygon, support_edges([corners]))
    assert 0.0 <= lost.max() < 0.006  # m
    square = polygon[[1, 2, 5, 6]]
    assert sole_corners(square) is square
    model = simulation_of(op3(), start=standing()).world.model
    floor = model.geom("physics_floor")
    for index in range(model.ngeom):
        geom = model.geom(index)
        sees = bool(geom.conaffinity[0] & floor.contype[0])
        if geom.name.startswith(SOLE):
            assert sees and not geom.contype[0]
        elif geom.name != "physics_floor" and geom.contype[0]:  # the others are for looking at
            assert sees is ("foot" not in geom.name)


def test_a_robot_on_a_stand_keeps_its_root_and_on_a_gantry_hangs_below_its_hook() -> None:
    rig, gantry = PhysicsRig(mount=Mount(Support.STAND)), PhysicsRig(mount=Mount(Support.GANTRY, hook="neck"))
    rig.arm()
    states, stand = rig.run(1.0), rig.bus.witness
    assert stand.fall is None and not stand.state.load.any()
    assert rig.error(states) < 0.03
    assert not np.ptp(stand.log.column("root"), axis=0).any()
    assert stand.state.sole[:, 2].min() > 0.04
    gantry.arm()
    gantry.run(3.0)
    witness, state = gantry.bus.witness, gantry.bus.witness.state
    assert witness.fall is None and not state.load.any() and not state.touching
    assert np.ptp(witness.log.column("root")[200:, 2]) < 5e-3
    neck = op3().points(state.q[None], ("neck",))[0, 0]
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


def test_a_robot_without_feet_or_gains_and_a_missing_engine_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, start, joints = op3(), standing(), op3().joint_map
    without_feet = replace(robot, profile=robot.profile.model_copy(update={"feet": {}}))
    servos = [replace(servo, gains=type(servo.gains)()) for servo in joints.servos]
    with refuses(ConfigError):
        simulation_of(without_feet, start=start)
    with refuses(ConfigError, 20, "r_sho_pitch"):
        simulation_of(replace(robot, joint_map=type(joints)(servos)), start=start)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for start_of_it in (lambda: simulation_of(robot, start=start), lambda: load_robot("op3")):
        with refuses(ConfigError, "MuJoCo"):
            start_of_it()
