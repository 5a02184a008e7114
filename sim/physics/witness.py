"""The witness of a simulated robot in a run: its state and log, whether it fell, and what is reported of it."""

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

# The log, tick by tick: states, slip of soles, extremes.

MAX_ROWS = 450_000
"""Most ticks that are kept, an hour at 125 Hz; the sums go on after them."""
BLOCK_ROWS = 4096
"""Memory is allocated for so many at a time, and nothing is ever moved."""
SLIP_RESOLUTION_M = 1e-4
"""A sole that carries has slipped when its corners are this far from where they were. Trembling below this does not add
up."""
LIFTED_S = 0.05
"""A sole without load for longer has been lifted: the way to where it comes down is no slip. A sliding sole trembles,
and is without load for shorter times."""


class PhysicsLog:
    """Rows of states, in single precision but for the time; `rows` says how many.

    slip_m (k,): horizontal path length of each sole while it carried: the mean of its corners, weighted by their loads.
    So a sole that turns on its spot slips, and one that rocks on a fixed edge does not. worst_tilt: of a
    sole that carried, rad.
    hottest (n,): of each servo, degrees Celsius. self_contact_ticks: with links touching each other.
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
        """corners (c,): of which sole each corner is. loaded: which soles carry, by the load on each."""
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
        self._sum(state)
        if self.rows == MAX_ROWS:
            return
        row = self.rows % BLOCK_ROWS
        if row == 0:
            self._blocks.append(np.zeros(BLOCK_ROWS, self._row))
        self._blocks[-1][row] = tuple(getattr(state, name) for name in self._row.names or ())
        self.rows += 1

    def column(self, name: str) -> FloatArray:
        """The rows of one quantity of `PhysicsState`: time (rows,), else (rows, width); sole (rows, k, 3).

        Kept are time, q, root, com, zmp, load, sole, tilt and torque.
        """
        blocks = [block[name] for block in self._blocks] or [np.zeros(0, self._row)[name]]
        return np.asarray(np.concatenate(blocks)[: self.rows], dtype=np.float64)

    def _sum(self, state: PhysicsState) -> None:
        """Update sums and extremes."""
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

    def _slide(self, sole: int, places: list[tuple[float, float]], pressed: list[float]) -> None:
        """Add the displacement of the corners of a sole that carries. In plain floats: they are few."""
        anchors, load = self._anchors[sole], sum(pressed)
        if anchors is None or load <= 0.0:  # it has just touched down
            self._anchors[sole] = places
            return
        way = sum(force * hypot(x - u, y - v) for force, (x, y), (u, v) in zip(pressed, places, anchors, strict=True))
        if way > SLIP_RESOLUTION_M * load:
            self.slip_m[sole] += way / load
            self._anchors[sole] = places


# Whether a simulated robot has fallen.
#
# It has fallen if one of these holds:
#   - every sole tips more than MOST_TILT (a torso that bends low over flat soles is no fall);
#   - its pelvis (the root link, where the profile has no such frame) is lower than LOW_SHARE of its height in `stand`,
#     or, where posture `rest` is lower still, than REST_SHARE of its height there;
#   - anything but soles and hands touches the floor (a hand there is no fall by itself), except in posture `rest`.
#
# A robot without torque that goes down has fallen too, unless it was at rest: then it has sat down.

MOST_TILT = radians(30.0)
"""Tilt of a sole, rad."""
LOW_SHARE, REST_SHARE = 0.5, 0.8
"""Shares of the height of the pelvis."""


@dataclass(frozen=True)
class Fall:
    """time: s since the bus was opened. how: in words. powered: whether servos had torque."""

    time: float
    how: str
    powered: bool


class FallWatch:
    """Judges states of a robot that stands on the floor."""

    def __init__(self, robot: RobotBody) -> None:
        self._robot = robot
        stand, rest = (plant(robot, posture) for posture in (robot.profile.postures.stand, robot.profile.postures.rest))
        # Height of the pelvis over the root link, in the frame of the root: so each state costs one rotation.
        frame = robot.profile.frames.get("pelvis")
        on_root = frame is not None and robot.frame("pelvis").body == int(np.flatnonzero(robot.body.parent == 0)[1])
        self._pelvis = robot.frame("pelvis").position.tolist() if on_root else [0.0, 0.0, 0.0]
        heights = [stance.q[2] + _raised(stance.q.tolist(), self._pelvis) for stance in (stand, rest)]
        self.lowest = min(LOW_SHARE * heights[0], REST_SHARE * heights[1])
        """Of the pelvis, m."""
        self._rest = robot.posture(robot.profile.postures.rest)[robot.servo_columns]

    def look(self, state: PhysicsState) -> str | None:
        """Return how it has fallen, in words; None: it stands."""
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
        """Whether a posture (nq,) is the profile's posture `rest`."""
        return bool(np.abs(q[self._robot.servo_columns] - self._rest).max() <= NEAR_REST)


def _raised(root: Sequence[float], point: Sequence[float]) -> float:
    """How high a point (3,) of a root link is over its origin; root: xyz, wxyz. In plain floats, for every tick."""
    w, i, j, k = root[3:7]
    x, y, z = point
    return 2.0 * (i * k - w * j) * x + 2.0 * (j * k + w * i) * y + (1.0 - 2.0 * (i * i + j * j)) * z


# The witness: the present state, the log, and whether it fell.

AFTERMATH_S = 1.5
"""Time, s, that a robot is watched for a fall after its torque went off for good."""
LOOK_S = 0.008
"""Time, s, between two looks then."""


class Witness:
    """state: as of the last `look`. log: of every look since torque first went on. powered: whether the servos have
    torque. at_rest: whether the robot was in its rest posture when its torque went off last: then going down is sitting
    down. fall: the first; None: it has not fallen, or hangs. toppled: how a robot at rest went down when its torque
    went off, if it did not stay sitting; that is no `fall`, but no good rest posture either."""

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
        if self.powered and not on and self._watch is not None:
            self.at_rest = self._watch.at_rest(self._reader.read().q)
        self.powered = on

    def see_it_out(self) -> None:
        """Watch for AFTERMATH_S on the simulation's own time."""
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

    def limit_drive(self, share: float) -> None:
        """Limit its drive. Raises BusError as it does."""
        self._bus.limit_drive(share)

    def torque(self, on: bool) -> None:
        """Switch its torque. Raises BusError as it does."""
        try:
            self._bus.torque(on)
        finally:
            self.witness.switched(on)

    def close(self) -> None:
        """Close it, and watch for AFTERMATH_S whether the robot falls: one that still has torque before that, as it
        would keep it. Raises BusError as it does."""
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
