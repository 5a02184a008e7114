"""The witness of a simulated robot in a run: present state, log, whether it fell, and what is reported of it."""

from dataclasses import replace

import numpy as np

from hardware.arrays import BoolArray, FloatArray
from hardware.bus import ServoBus, ServoGoals, ServoStates
from retarget.ik.support_polygon import sole_outline, support_distance, support_edges
from retarget.model.body import JointType
from retarget.model.robot import RobotBody
from retarget.run.run_result import Fallen, PhysicsRun
from sim.physics.log import Fall, FallWatch, PhysicsLog
from sim.physics.mount import Support
from sim.physics.simulation import Simulation
from sim.physics.state import LOADED_SHARE, PhysicsState, StateReader

AFTERMATH_S = 1.5
"""Time, s, that a robot is watched for a fall after its torque went off for good."""
LOOK_S = 0.008
"""Time, s, between two looks then."""


class Witness:
    """state: as of the last `look`. log: of every look since torque first went on. at_rest: whether the robot
    was in its rest posture when its torque went off last: then going down is sitting down. fall: the first; None: it
    has not fallen, or hangs. toppled: how a robot at rest went down when its torque went off, if it did not stay
    sitting; that is no `fall`, but no good rest posture either."""

    def __init__(self, simulation: Simulation) -> None:
        world = simulation.world
        self.simulation = simulation
        self._reader = StateReader(simulation)
        self._watch = FallWatch(world.robot) if world.mount.support is Support.FLOOR else None
        self.fall: Fall | None = None
        self.toppled: Fall | None = None
        self._powered = False
        self.at_rest = False
        self.state: PhysicsState = self._reader.read()
        self.log = PhysicsLog(
            servos=len(world.drives),
            soles=len(world.soles),
            corners=self._reader.corner_soles,
            nq=world.robot.body.nq,
            loaded=self._reader.loaded,
        )

    @property
    def soles(self) -> BoolArray | None:
        """Mask (k,) of the soles that carried at the last look; None: a hand holds the robot, or its feet are in the
        air for good."""
        if self._watch is None or self.simulation.held:
            return None
        return self._reader.loaded(self.state.load)

    def look(self) -> None:
        """Take the present state."""
        self.state = state = self._reader.read()
        if self.simulation.moves:
            self.log.add(state)
            self._judge(state)

    def switched(self, on: bool) -> None:
        """Note that torque has been switched."""
        if self._powered and not on and self._watch is not None:
            self.at_rest = self._watch.at_rest(self._reader.read().q)
        self._powered = on

    def see_it_out(self) -> None:
        """Watch for AFTERMATH_S on the simulation's own time."""
        if self._watch is None or not self.simulation.moves:
            return
        for _ in range(round(AFTERMATH_S / LOOK_S)):
            self.simulation.advance(self.simulation.time + LOOK_S)
            self._judge(self._reader.read())

    def _judge(self, state: PhysicsState) -> None:
        sits = self.at_rest and not self._powered
        if self._watch is None or (self.toppled if sits else self.fall) is not None:
            return
        how = self._watch.look(state)
        if how is not None and sits:
            self.toppled = Fall(state.time, how, self._powered)
        elif how is not None:
            self.fall = Fall(state.time, how, self._powered)


# Any bus above a simulated robot, with a witness at each read.


class WitnessedBus:
    """A `hardware.bus.ServoBus` that passes every call to another one. `witness` has what the report needs."""

    def __init__(self, bus: ServoBus, witness: Witness) -> None:
        self._bus = bus
        self._seen_out = False
        self.witness = witness

    def open(self) -> None:
        """Open the other bus. Raises BusError as it does."""
        self._bus.open()

    def read(self) -> ServoStates:
        """Read it, observe the robot, and add the contact state of its soles. Raises BusError as it does."""
        states = self._bus.read()
        self.witness.look()
        return replace(states, soles=self.witness.soles)

    def write(self, goals: ServoGoals) -> None:
        """Write to it. Raises BusError as it does."""
        self._bus.write(goals)

    def torque(self, on: bool) -> None:
        """Switch its torque. Raises BusError as it does."""
        try:
            self._bus.torque(on)
        finally:
            self.witness.switched(on)

    def close(self) -> None:
        """Close it, then watch for AFTERMATH_S whether the robot falls. Raises BusError as it does."""
        try:
            self._bus.close()
        finally:
            if not self._seen_out:
                self._seen_out = True
                self.witness.switched(False)
                self.witness.see_it_out()


# From the witness of a simulated robot to the result of a run.


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


def physics_run(
    witness: Witness, *, begun: float = 0.0, seed: int = 0, perturbations: tuple[str, ...] = ()
) -> PhysicsRun:
    """Return what was observed up to now. begun: the run's time, s, at the first look after torque went on."""
    log, world = witness.log, witness.simulation.world
    time = log.column("time")
    later = begun - float(time[0]) if log.rows else 0.0
    robot_joints = world.robot.body.joint_qpos[world.robot.body.joint_type > JointType.BALL]
    return PhysicsRun(
        mount=world.mount.support.value,
        seed=seed,
        perturbations=perturbations,
        fall=_fallen(witness.fall, later),
        toppled=_fallen(witness.toppled, later),
        time=time + later,
        body=np.hstack([log.column("root"), log.column("q")[:, robot_joints]]),
        com=log.column("com"),
        pressure=log.column("zmp"),
        margin=zmp_margins(world.robot, log, least_load=LOADED_SHARE * world.weight),
        slip=log.slip_m.copy(),
        tilt=log.worst_tilt,
        torque=log.column("torque"),
        hottest=np.where(np.isfinite(log.hottest), log.hottest, np.nan),
        contacts=(log.self_contact_ticks, log.fixture_contact_ticks),
    )


def _fallen(fall: Fall | None, later: float) -> Fallen | None:
    if fall is None:
        return None
    return Fallen(fall.time + later, fall.how if fall.powered else f"{fall.how}, without torque")
