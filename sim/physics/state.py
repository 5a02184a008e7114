"""The state of a simulated robot: contacts, and ground truth of balance."""

from dataclasses import dataclass
from math import nan
from typing import Any

import numpy as np

from hardware.arrays import BoolArray, FloatArray
from retarget import rotations
from sim.physics.ground import BALL_M, SOLE
from sim.physics.simulation import Simulation
from sim.physics.world import World

LOADED_SHARE = 0.03
"""Share of the robot's weight from which a sole carries."""


@dataclass(frozen=True, eq=False)
class PhysicsState:
    """One tick of n servos and k soles. World frame, SI.

    q (nq,): posture in the coordinates of the robot's own body; root (7,): xyz and wxyz of the root link. com (3,). zmp
    (2,): centre of pressure of the soles, NaN in the air and while a hand holds the robot. load (k,) N, sole (k, 3),
    tilt (k,) rad: of each sole. corner (c, 2): corners of all soles; pressed (c,): N on each. torque (n,) N m,
    temperature (n,) degrees Celsius. self_contacts: of links with each other; fixture_contacts: with fixtures, and of
    hands with the floor; touching: another link on the floor, or "".
    """

    time: float
    q: FloatArray
    root: FloatArray
    com: FloatArray
    zmp: FloatArray
    load: FloatArray
    sole: FloatArray
    tilt: FloatArray
    corner: FloatArray
    pressed: FloatArray
    torque: FloatArray
    temperature: FloatArray
    self_contacts: int
    fixture_contacts: int
    touching: str


class StateReader:
    """Reads the states of a simulation. corner_soles (c,): the sole of each corner."""

    def __init__(self, simulation: Simulation) -> None:
        world = simulation.world
        self._simulation, self._world = simulation, world
        self._least = LOADED_SHARE * world.weight
        self._owners = world.owners.tolist()
        links = world.robot.body.body_names
        self._feet = np.array([world.model.body(links[sole.body]).id for sole in world.soles], dtype=np.intp)
        self._places = np.array([sole.position for sole in world.soles]).reshape(-1, 3, 1)
        self._ups = np.array([rotations.rotate(sole.quat, np.array([0.0, 0.0, 1.0])) for sole in world.soles])
        self._ups = self._ups.reshape(-1, 3, 1)
        self.corner_soles = self._find_corners()
        self._own_root = 7 if world.robot.body.root == "free" else 0
        self._q = world.robot.body.qpos0.copy()
        self._joints = world.robot.body.joint_qpos[world.robot.body.joint_type > 1]

    def loaded(self, load: FloatArray) -> BoolArray:
        """Return which soles carry, by their loads (k,) N."""
        return np.asarray(load > self._least, dtype=np.bool_)

    def read(self) -> PhysicsState:
        """Read the present state of the simulation."""
        simulation, data = self._simulation, self._simulation.data
        load, pressed, zmp, counts = self._contacts(data)
        turns = data.xmat[self._feet].reshape(-1, 3, 3)
        sole = data.xpos[self._feet] + (turns @ self._places)[:, :, 0]
        of = self._corner_rows
        corner = data.xpos[self._feet[of]] + (turns[of] @ self._corners)[:, :, 0]
        # The vertical part of each sole's normal is the cosine of its tilt; rounding may lift it above 1.
        up = np.minimum((turns @ self._ups)[:, 2, 0], 1.0)
        link = self._world.root
        free = self._world.free
        root = np.array(data.qpos[:7]) if free else np.concatenate([data.xpos[link], data.xquat[link]])
        self._q[self._joints] = data.qpos[self._world.columns]
        if self._own_root:
            self._q[:7] = root
        return PhysicsState(
            time=simulation.time,
            q=self._q.copy(),
            root=root,
            com=data.subtree_com[self._world.root].copy(),
            zmp=zmp,
            load=load,
            sole=sole,
            tilt=np.arccos(up),
            corner=corner[:, :2],
            pressed=pressed,
            torque=simulation.motors.torque(data),
            temperature=simulation.electrics.temperature,
            self_contacts=counts[0],
            fixture_contacts=counts[1],
            touching=counts[2],
        )

    def _find_corners(self) -> tuple[int, ...]:
        model = self._world.model
        balls = [geom for geom in range(model.ngeom) if model.geom(geom).name.startswith(SOLE)]
        self._corner_of = {ball: row for row, ball in enumerate(balls)}
        soles = tuple(int(self._world.owners[ball]) - 1 for ball in balls)
        self._corner_rows = np.array(soles, dtype=np.intp)
        # Lowest point of each ball below a level sole, (c, 3, 1) [m] on the link.
        self._corners = model.geom_pos[balls].reshape(-1, 3, 1) - BALL_M * self._ups[self._corner_rows]
        return soles

    def _contacts(self, data: Any) -> tuple[FloatArray, FloatArray, FloatArray, tuple[int, int, str]]:
        """Return loads of soles (k,) and corners (c,) N, centre of pressure (2,) m, and the contacts: their number
        between links and with fixtures, and a link on the floor.

        The first row of a contact is its normal force (elliptic cone).
        """
        load, pressed = [0.0] * len(self._feet), [0.0] * len(self._corner_of)
        own = fixtures = 0
        touching = ""
        total = moment_x = moment_y = 0.0
        if data.ncon:
            contact, owners, forces = data.contact, self._owners, data.efc_force.tolist()
            pairs, rows = contact.geom.tolist(), contact.efc_address.tolist()
            for (first, second), row, (x, y, _) in zip(pairs, rows, contact.pos.tolist(), strict=True):
                low, high = sorted((owners[first], owners[second]))
                if high == World.FIXTURES or (low == 0 and high == World.HANDS):
                    fixtures += 1
                elif low > 0:
                    own += 1
                elif high == World.ROBOT:
                    model, geom = self._world.model, first if owners[first] == World.ROBOT else second
                    touching = model.body(model.geom_bodyid[geom]).name
                elif row >= 0:
                    force = forces[row]
                    load[high - 1] += force
                    pressed[self._corner_of[first if owners[first] == high else second]] += force
                    total += force
                    moment_x += force * x
                    moment_y += force * y
        # Centre of pressure: the mean of the contact points, weighted by their normal forces.
        carried = total > self._least and not self._simulation.held
        zmp = (moment_x / total, moment_y / total) if carried else (nan, nan)
        return np.array(load), np.array(pressed), np.array(zmp), (own, fixtures, touching)
