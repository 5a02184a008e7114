"""The simulation: time in steps, pushes, and what diverges."""

import numpy as np
import pytest

from hardware.errors import BusError
from physics_rig import op3, standing
from sim.physics.perturbation import Push
from sim.physics.simulation import LONGEST_S, Simulation
from sim.physics_bus import simulation_of
from support.messages import refuses

ALL = np.ones(20, dtype=np.bool_)


def running(seed: int = 0) -> Simulation:
    simulation = simulation_of(op3(), start=standing(), seed=seed)
    simulation.switch(ALL)
    return simulation


def test_time_goes_in_whole_steps_and_never_back() -> None:
    simulation = running()
    simulation.advance(0.0109)
    assert simulation.time == pytest.approx(0.010)
    simulation.advance(0.004)
    assert simulation.time == pytest.approx(0.010)
    assert float(simulation.data.time) == pytest.approx(0.010)


def test_however_it_is_cut_the_motion_is_the_same_within_a_batch() -> None:
    whole, cut = running(), running()
    whole.advance(0.008)
    for step in range(1, 5):
        cut.advance(0.002 * step)
    assert whole.data.qpos.tolist() == pytest.approx(cut.data.qpos.tolist(), abs=1e-5)


def test_a_long_silence_is_cut_short() -> None:
    simulation = simulation_of(op3(), start=standing())
    simulation.advance(1e6)
    assert simulation.time == pytest.approx(1e6)
    assert not simulation.moves
    assert LONGEST_S <= 60.0


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


def test_what_diverges_is_said() -> None:
    simulation = running()
    simulation.data.qvel[8] = np.nan
    with refuses(BusError):
        simulation.advance(0.1)
    simulation.advance(0.2)  # and after that nothing moves


def test_servos_differ_by_seed() -> None:
    frictions = [running(seed)._model.dof_frictionloss[6:].copy() for seed in (1, 1, 2)]
    assert frictions[0].tolist() == frictions[1].tolist() != frictions[2].tolist()
    assert 0.09 < frictions[0].min() < frictions[0].max() < 0.12
