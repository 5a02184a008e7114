"""From who watched a simulated robot to what a report takes from it."""

import numpy as np

from retarget.physics_run import Fallen, PhysicsRun
from sim.physics.fall import Fall
from sim.physics.state import LOADED_SHARE
from sim.physics.summary import zmp_margins
from sim.physics.witness import Witness

__all__ = ["physics_run"]


def physics_run(witness: Witness, *, begun: float = 0.0, seed: int = 0, trouble: tuple[str, ...] = ()) -> PhysicsRun:
    """What was seen up to now. begun: the run's time, s, at the first look after torque went on."""
    log, world = witness.log, witness.simulation.world
    time = log.column("time")
    later = begun - float(time[0]) if log.rows else 0.0
    return PhysicsRun(
        mount=world.mount.support.value,
        seed=seed,
        trouble=trouble,
        fall=_fallen(witness.fall, later),
        toppled=_fallen(witness.toppled, later),
        time=time + later,
        com=log.column("com"),
        pressure=log.column("zmp"),
        margin=zmp_margins(world.robot, log, least_load=LOADED_SHARE * world.weight),
        slip=log.slip_m.copy(),
        tilt=log.worst_tilt,
        torque=log.column("torque"),
        hottest=np.where(np.isfinite(log.hottest), log.hottest, np.nan),
        self_contacts=log.self_contact_ticks,
        fixture_contacts=log.fixture_contact_ticks,
    )


def _fallen(fall: Fall | None, later: float) -> Fallen | None:
    if fall is None:
        return None
    return Fallen(fall.time + later, fall.how if fall.powered else f"{fall.how}, without torque")
