"""Soles that are held stay where they are, while the body above them moves and the engine would let them creep."""

import numpy as np
import pytest

from hardware.arrays import FloatArray
from physics_rig import PhysicsRig, op3, standing
from retarget.model.body_file import engine
from sim.buses import simulation_of
from sim.physics.mount import Mount, Support
from sim.physics.perturbation import Push
from sim.physics.simulation import Simulation, SoleSteps

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


def creep(rig: PhysicsRig) -> float:
    """Greatest speed, m/s, along the floor of a corner that is held, 8 ms later."""
    rig.bus.witness.simulation._steps.take(4)
    data = rig.bus.witness.simulation.data
    engine().mj_step1(rig.bus.witness.simulation.world.model, data)
    rows = data.contact.efc_address[:, None] + np.array([1, 2])
    return float(np.abs(data.efc_vel[rows]).max())


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
def test_it_is_the_derivative_of_the_jacobian(seed: int) -> None:
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


ALL = np.ones(20, dtype=np.bool_)


def running(seed: int = 0) -> Simulation:
    simulation = simulation_of(op3(), start=standing(), seed=seed)
    simulation.switch(ALL)
    return simulation


def test_however_it_is_cut_the_motion_is_the_same_within_a_batch() -> None:
    whole, cut = running(), running()
    whole.advance(0.008)
    for step in range(1, 5):
        cut.advance(0.002 * step)
    assert whole.data.qpos.tolist() == pytest.approx(cut.data.qpos.tolist(), abs=1e-5)


def test_a_push_begins_and_ends_on_time() -> None:
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
