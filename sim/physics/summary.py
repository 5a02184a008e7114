"""What a report says of a run with physics."""

from dataclasses import dataclass

import numpy as np

from hardware.arrays import FloatArray
from retarget.robot_body import RobotBody
from retarget.support import sole_outline, support_distance, support_edges
from sim.physics.fall import Fall
from sim.physics.log import PhysicsLog
from sim.physics.state import LOADED_SHARE
from sim.physics.witness import Witness

__all__ = ["PhysicsSummary", "physics_summary", "zmp_margins"]


@dataclass(frozen=True, eq=False)
class PhysicsSummary:
    """fall: the first, None while it stands. slip_m: horizontal way of all soles while they carried, together; tilt:
    worst of a sole that carried, rad. zmp_margin: least distance of the centre of pressure to the edge of the soles
    that carried, m, NaN where none did. torque (n,) N m, temperature (n,) degrees Celsius: most of each servo, in servo
    order; heat is of a stated model that nobody has calibrated. self_contacts, fixture_contacts: ticks with any."""

    fall: Fall | None
    slip_m: float
    tilt: float
    zmp_margin: float
    torque: FloatArray
    temperature: FloatArray
    self_contacts: int
    fixture_contacts: int


def physics_summary(witness: Witness) -> PhysicsSummary:
    """The numbers of a run up to now."""
    log, world = witness.log, witness.simulation.world
    margins = zmp_margins(world.robot, log, least_load=LOADED_SHARE * world.weight)
    known = margins[np.isfinite(margins)]
    return PhysicsSummary(
        fall=witness.fall,
        slip_m=float(log.slip_m.sum()),
        tilt=log.worst_tilt,
        zmp_margin=float(known.min()) if known.size else float("nan"),
        torque=log.most_torque.copy(),
        temperature=log.hottest.copy(),
        self_contacts=log.self_contact_ticks,
        fixture_contacts=log.fixture_contact_ticks,
    )


def zmp_margins(robot: RobotBody, log: PhysicsLog, *, least_load: float) -> FloatArray:
    """How far (rows,) m the centre of pressure was inside the hull of the soles that carried `least_load` N or more;
    NaN where none did, and while a hand held the robot."""
    margins = np.full(log.rows, np.nan)
    feet = list(robot.profile.feet.values())
    if not feet or not log.rows or robot.body.root != "free":
        return margins
    turns = robot.orientations(log.column("q"), tuple(foot.frame for foot in feet))  # (rows, k, 4)
    polygons = [np.array(foot.polygon) for foot in feet]
    soles, loads, zmp = log.column("sole"), log.column("load"), log.column("zmp")
    for row in np.flatnonzero(np.isfinite(zmp[:, 0]) & (loads >= least_load).any(axis=1)).tolist():
        outlines = [
            sole_outline(soles[row, sole], turns[row, sole], polygon)
            for sole, polygon in enumerate(polygons)
            if loads[row, sole] >= least_load
        ]
        margins[row] = support_distance(zmp[row], support_edges(outlines))
    return margins
