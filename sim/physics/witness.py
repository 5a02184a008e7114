"""The witness of a simulated robot in a run: its log, its fall, and their report."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import degrees, hypot, radians

import numpy as np
from numpy.typing import NDArray

from hardware.arrays import BoolArray, FloatArray
from hardware.bus import ServoBus, ServoGoals, ServoStates
from retarget.ik.support_polygon import plant, sole_outline, support_distance, support_edges
from retarget.model.body import JointType
from retarget.model.robot import RobotBody
from retarget.run.run_result import Fallen, PhysicsRun
from retarget.run.tick import NEAR_REST
from sim.physics.mount import Support
from sim.physics.simulation import Simulation
from sim.physics.state import LOADED_SHARE, PhysicsState, StateReader

MAX_ROWS = 450_000
"""Most ticks of a log, an hour at 125 Hz; sums and extremes go on."""
BLOCK_ROWS = 4096
"""Rows of a block of memory; full blocks are not moved."""
SLIP_RESOLUTION_M = 1e-4
"""Displacement of the corners from which slip counts, so that trembling does not add up."""
LIFTED_S = 0.05
"""A sole without load for longer has been lifted: its displacement is no slip."""


class PhysicsLog:
    """States, in single precision but for the time, and their sums and extremes.

    slip_m (k,): horizontal path length of each sole while it carried: the mean of its corners, weighted by their loads,
    so that rocking on a fixed edge is no slip. worst_tilt: of a sole that carried, rad. hottest (n,): degrees Celsius.
    """

    def __init__(
        self,
        *,
        servos: int,
        soles: int,
        corners: Sequence[int],
        nq: int,
        loaded: Callable[[FloatArray], BoolArray],
    ) -> None:
        """corners (c,): the sole of each corner. loaded: returns which soles carry, by their loads."""
        shapes: dict[str, tuple[int, ...]] = {"q": (nq,), "root": (7,), "com": (3,), "zmp": (2,), "load": (soles,)}
        shapes |= {"sole": (soles, 3), "tilt": (soles,), "torque": (servos,)}
        self._row = np.dtype([("time", "f8"), *((name, "f4", shape) for name, shape in shapes.items())])
        self._blocks: list[NDArray[np.void]] = []
        self._loaded = loaded
        self._corners = [[row for row, of in enumerate(corners) if of == sole] for sole in range(soles)]
        self._anchors: list[list[tuple[float, float]] | None] = [None] * soles
        self._borne = [-np.inf] * soles  # when each carried last, s
        self.rows = 0
        self.slip_m = np.zeros(soles)
        self.worst_tilt = 0.0
        self.hottest = np.full(servos, -np.inf)
        self.self_contact_ticks = 0
        self.fixture_contact_ticks = 0

    def add(self, state: PhysicsState) -> None:
        """Append a state of the simulation."""
        carries, tilts = self._loaded(state.load).tolist(), state.tilt.tolist()
        places, pressed = state.corner.tolist(), state.pressed.tolist()
        for sole, corners in enumerate(self._corners):
            if not carries[sole]:
                continue
            if state.time - self._borne[sole] > LIFTED_S:
                self._anchors[sole] = None
            self._borne[sole] = state.time
            self.worst_tilt = max(self.worst_tilt, tilts[sole])
            self._slide(sole, [places[row] for row in corners], [pressed[row] for row in corners])
        np.maximum(self.hottest, state.temperature, out=self.hottest)
        self.self_contact_ticks += state.self_contacts > 0
        self.fixture_contact_ticks += state.fixture_contacts > 0
        if self.rows == MAX_ROWS:
            return
        row = self.rows % BLOCK_ROWS
        if row == 0:
            self._blocks.append(np.zeros(BLOCK_ROWS, self._row))
        self._blocks[-1][row] = tuple(getattr(state, name) for name in self._row.names or ())
        self.rows += 1

    def column(self, name: str) -> FloatArray:
        """Return one quantity of `PhysicsState`: (rows,) or (rows, width), sole (rows, k, 3)."""
        blocks = [block[name] for block in self._blocks] or [np.zeros(0, self._row)[name]]
        return np.asarray(np.concatenate(blocks)[: self.rows], dtype=np.float64)

    def _slide(self, sole: int, places: list[tuple[float, float]], pressed: list[float]) -> None:
        anchors, load = self._anchors[sole], sum(pressed)
        if anchors is None or load <= 0.0:  # it has just touched down
            self._anchors[sole] = places
            return
        slip = sum(force * hypot(x - u, y - v) for force, (x, y), (u, v) in zip(pressed, places, anchors, strict=True))
        if slip > SLIP_RESOLUTION_M * load:
            self.slip_m[sole] += slip / load
            self._anchors[sole] = places


MOST_TILT = radians(30.0)
"""Tilt of a sole, rad."""
LOW_SHARE, REST_SHARE = 0.5, 0.8
"""Shares of the height of the pelvis in `stand` and in `rest`."""


@dataclass(frozen=True)
class Fall:
    """A fall. time: s since the bus was opened. how: in words. powered: servos had torque."""

    time: float
    how: str
    powered: bool


class FallWatch:
    """Judges states of a robot that stands on the floor.

    It has fallen if every sole tilts more than MOST_TILT, if its pelvis (else its root link) is below LOW_SHARE of its
    height in `stand` and REST_SHARE of that in `rest`, or if a link other than soles and hands touches the floor
    outside `rest`. lowest: bound on the height of the pelvis, m.
    """

    def __init__(self, robot: RobotBody) -> None:
        self._robot = robot
        stand, rest = (plant(robot, posture) for posture in (robot.profile.postures.stand, robot.profile.postures.rest))
        frame = robot.profile.frames.get("pelvis")
        on_root = frame is not None and robot.frame("pelvis").body == int(np.flatnonzero(robot.body.parent == 0)[1])
        self._pelvis = robot.frame("pelvis").position.tolist() if on_root else [0.0, 0.0, 0.0]
        heights = [stance.q[2] + _raised(stance.q.tolist(), self._pelvis) for stance in (stand, rest)]
        self.lowest = min(LOW_SHARE * heights[0], REST_SHARE * heights[1])
        self._rest = robot.posture(robot.profile.postures.rest)[robot.servo_columns]

    def look(self, state: PhysicsState) -> str | None:
        """Return its fall in words; None: it stands."""
        root = state.root.tolist()
        if state.tilt.min(initial=np.inf) > MOST_TILT:
            return f"the soles tip by {degrees(state.tilt.min()):.0f} degrees"
        height = root[2] + _raised(root, self._pelvis)
        if height < self.lowest:
            return f"the pelvis is {1e3 * height:.0f} mm high, allowed {1e3 * self.lowest:.0f}"
        if state.touching and not self.at_rest(state.q):
            return f"{state.touching} touches the floor"
        return None

    def at_rest(self, q: FloatArray) -> bool:
        """Return whether a posture (nq,) is the profile's posture `rest`."""
        return bool(np.abs(q[self._robot.servo_columns] - self._rest).max() <= NEAR_REST)


def _raised(root: Sequence[float], point: Sequence[float]) -> float:
    """The height of a point (3,) of a root link over its origin. root: xyz, wxyz. In plain floats: each tick."""
    w, i, j, k = root[3:7]
    x, y, z = point
    return 2.0 * (i * k - w * j) * x + 2.0 * (j * k + w * i) * y + (1.0 - 2.0 * (i * i + j * j)) * z


AFTERMATH_S = 1.5
"""Time for which a robot may fall after its torque went off for good, s."""
LOOK_S = 0.008
"""Period of the states in that time, s."""


class Witness:
    """The observer of a simulated robot.

    log: of every look since torque first went on. at_rest: the robot was in its rest posture when torque last went off,
    so that going down is sitting down. fall: the first; None: it has not fallen, or hangs. toppled: how a robot at rest
    went down without torque, which is no `fall`.
    """

    def __init__(self, simulation: Simulation) -> None:
        world = simulation.world
        self.simulation = simulation
        self._reader = StateReader(simulation)
        self._watch = FallWatch(world.robot) if world.mount.support is Support.FLOOR else None
        self.fall: Fall | None = None
        self.toppled: Fall | None = None
        self.powered = False
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
        """Mask (k,) of the soles that carried at the last look; None: a hand, a stand or a rope holds the robot."""
        if self._watch is None or self.simulation.held:
            return None
        return self._reader.loaded(self.state.load)

    def look(self) -> None:
        """Read the present state."""
        self.state = state = self._reader.read()
        if self.simulation.moves:
            self.log.add(state)
            self._judge(state)

    def switched(self, on: bool) -> None:
        """Note that torque has been switched."""
        if self.powered and not on and self._watch is not None:
            self.at_rest = self._watch.at_rest(self._reader.read().q)
        self.powered = on

    def see_it_out(self) -> None:
        """Simulate AFTERMATH_S, and judge whether the robot falls."""
        if self._watch is None or not self.simulation.moves:
            return
        for _ in range(round(AFTERMATH_S / LOOK_S)):
            self.simulation.advance(self.simulation.time + LOOK_S)
            self._judge(self._reader.read())

    def _judge(self, state: PhysicsState) -> None:
        sits = self.at_rest and not self.powered
        if self._watch is None or (self.toppled if sits else self.fall) is not None:
            return
        how = self._watch.look(state)
        if how is not None and sits:
            self.toppled = Fall(state.time, how, self.powered)
        elif how is not None:
            self.fall = Fall(state.time, how, self.powered)


class WitnessedBus:
    """A `hardware.bus.ServoBus` that passes every call to another one, with its errors, and observes the robot."""

    def __init__(self, bus: ServoBus, witness: Witness) -> None:
        self._bus = bus
        self._seen_out = False
        self.witness = witness

    def open(self) -> None:
        """Open the other bus."""
        self._bus.open()

    def read(self) -> ServoStates:
        """Read it, and add the contact state of the soles."""
        states = self._bus.read()
        self.witness.look()
        return replace(states, soles=self.witness.soles)

    def write(self, goals: ServoGoals) -> None:
        """Write to it."""
        self._bus.write(goals)

    def limit_drive(self, share: float) -> None:
        """Limit its drive."""
        self._bus.limit_drive(share)

    def torque(self, on: bool) -> None:
        """Switch its torque."""
        try:
            self._bus.torque(on)
        finally:
            self.witness.switched(on)

    def close(self) -> None:
        """Close it, and simulate whether the robot falls: before that, if it still has torque."""
        if self.witness.powered:
            self._see_out()
        try:
            self._bus.close()
        finally:
            self._see_out()

    def _see_out(self) -> None:
        if not self._seen_out:
            self._seen_out = True
            self.witness.see_it_out()


def zmp_margins(robot: RobotBody, log: PhysicsLog, *, least_load: float) -> FloatArray:
    """The distance (rows,) m of the centre of pressure inside the hull of the soles with `least_load` N or more;
    NaN without any, and while a hand holds the robot."""
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
    """The observations. begun: the run's time, s, at the first look after torque went on."""
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
