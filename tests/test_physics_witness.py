"""The witness: looks at a run, and sees it out."""

from dataclasses import replace

import numpy as np

from physics_rig import op3, standing
from sim.physics.mount import Mount, Support
from sim.physics.witness import AFTERMATH_S, Witness
from sim.physics_bus import simulation_of


def test_nothing_is_logged_before_torque() -> None:
    simulation = simulation_of(op3(), start=standing())
    witness = Witness(simulation)
    simulation.advance(1.0)
    witness.look()
    assert witness.log.rows == 0 and witness.state.time == 1.0
    simulation.switch(np.ones(20, dtype=np.bool_))
    simulation.advance(1.1)
    witness.look()
    assert witness.log.rows == 1


def test_what_never_moved_is_not_seen_out() -> None:
    simulation = simulation_of(op3(), start=standing())
    witness = Witness(simulation)
    witness.see_it_out()
    assert simulation.time == 0.0 and not witness.fallen


def test_a_robot_that_is_left_without_torque_is_seen_to_fall() -> None:
    simulation = simulation_of(op3(), start=standing())
    witness = Witness(simulation)
    for on in (True, False):
        simulation.switch(np.full(20, on))
        witness.switched(on)
        simulation.advance(simulation.time + 1.0 * on)
    witness.see_it_out()
    assert witness.fall is not None and not witness.fall.powered and not witness.parked
    assert 1.0 < witness.fall.time < 1.0 + AFTERMATH_S


def test_on_a_mount_nobody_falls() -> None:
    simulation = simulation_of(op3(), start=standing(), mount=Mount(Support.STAND))
    witness = Witness(simulation)
    for on in (True, False):
        simulation.switch(np.full(20, on))
        witness.switched(on)
    witness.see_it_out()
    assert not witness.fallen


def test_a_robot_that_is_parked_where_it_cannot_stay_topples_and_that_is_no_fall() -> None:
    postures = op3().profile.postures.model_copy(update={"rest": op3().profile.postures.stand})
    robot = replace(op3(), profile=op3().profile.model_copy(update={"postures": postures}))
    simulation = simulation_of(robot, start=standing())
    witness = Witness(simulation)
    for on in (True, False):
        simulation.switch(np.full(20, on))
        witness.switched(on)
        simulation.advance(simulation.time + 1.0 * on)
    witness.see_it_out()
    assert witness.parked and not witness.fallen
    assert witness.toppled is not None and not witness.toppled.powered
