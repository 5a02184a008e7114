"""The mechanics of a robot over time: goals and torque in, shafts, contacts and heat out.

Time is seconds since the start, in whole steps of the engine. The seed determines the begin of each shaft within its
tick, and the friction of each servo.
"""

from collections import deque
from math import floor, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardware.arrays import BoolArray, FloatArray
from hardware.errors import BusError, describe
from retarget.model.body_file import engine
from sim.physics.ground import SOLE
from sim.physics.motors import SHAFT, Electrics, Motors
from sim.physics.mount import Hand, Support, damp_swinging
from sim.physics.perturbation import Perturbation, Push
from sim.physics.world import World

ROWS = np.arange(3)  # of a contact: its normal and two tangents


class SoleSteps:
    """Steps of the engine that add a term to the contacts of soles: dJ/dt v.

    A point with Jacobian J accelerates by J dv/dt + dJ/dt v. MuJoCo has a reference acceleration -b J v for the first
    part only, so that a sole that sticks to the floor creeps by dJ/dt v / b while the legs move (b: 337 per second with
    contacts of 6 ms). Here the second part is subtracted from the reference before forces are computed.
    """

    def __init__(self, model: Any, data: Any) -> None:
        mujoco = engine()
        self._first, self._second, self._jacobian = mujoco.mj_step1, mujoco.mj_step2, mujoco.mj_jacDot
        self._step = mujoco.mj_step
        self._model, self._data = model, data
        balls = [geom for geom in range(model.ngeom) if model.geom(geom).name.startswith(SOLE)]
        feet = sorted({int(model.geom_bodyid[ball]) for ball in balls})
        self._feet = feet
        self._foot: NDArray[np.intp] = np.full(model.ngeom, -1, dtype=np.intp)  # by geom; -1: no corner of a sole
        for ball in balls:
            self._foot[ball] = feet.index(int(model.geom_bodyid[ball]))
        self._change = np.zeros((6, model.nv))  # dJ/dt: of a place, of a turn
        self._bias = np.zeros((len(feet), 6))  # m/s^2, rad/s^2
        self._known: tuple[bytes, bytes] = b"", b""
        self._contacts = self._sorted()
        self._found: FloatArray = np.zeros((0, 3))

    def take(self, steps: int) -> None:
        """Go on by a few steps; the correction is computed at the first, and again when contacts change."""
        model, data = self._model, self._data
        if not self._feet:
            self._step(model, data, nstep=steps)
            return
        for step in range(steps):
            self._first(model, data)
            if data.ncon:
                self._correct(due=step == 0)
            self._second(model, data)

    def _correct(self, *, due: bool) -> None:
        """Subtract dJ/dt v from the reference accelerations of all corners in contact; recompute it if due."""
        contact = self._data.contact
        known = contact.geom.tobytes(), contact.efc_address.tobytes()
        if known != self._known:
            self._known, self._contacts = known, self._sorted()
            due = True
        rows = self._contacts[3]
        if not rows.size:
            return
        if due:
            self._found = self._accelerations()
        self._data.efc_aref[rows] -= self._found

    def _accelerations(self) -> FloatArray:
        """Return dJ/dt v of the corners in contact, (c, 3) m/s^2 along the rows of their contacts."""
        data, contact = self._data, self._data.contact
        which, foot, sign, _ = self._contacts
        change, velocity = self._change, data.qvel
        for index, body in enumerate(self._feet):
            # Time derivative of the Jacobian of each foot, at its origin.
            self._jacobian(self._model, data, change[:3], change[3:], data.xpos[body], body)
            np.matmul(change, velocity, out=self._bias[index])
        bias = self._bias[foot]
        x, y, z = (contact.pos[which] - data.xpos[self._feet][foot]).T
        turn_x, turn_y, turn_z = bias[:, 3:].T
        acceleration = bias[:, :3]
        # The angular part acts at a point by its arm: turn x r.
        acceleration[:, 0] += turn_y * z - turn_z * y
        acceleration[:, 1] += turn_z * x - turn_x * z
        acceleration[:, 2] += turn_x * y - turn_y * x
        frames = contact.frame[which].reshape(-1, 3, 3)
        return np.asarray(sign * (frames @ acceleration[:, :, None])[:, :, 0])

    def _sorted(self) -> tuple[NDArray[np.intp], NDArray[np.intp], FloatArray, NDArray[np.intp]]:
        """The contacts (c,) of corners of soles: index, foot, side (c, 1), 1 or -1, and rows (c, 3)."""
        contact = self._data.contact
        feet = self._foot[contact.geom].reshape(-1, 2)
        which = np.flatnonzero((feet.max(axis=1, initial=-1) >= 0) & (contact.efc_address >= 0))
        sign = np.where(feet[which, 1] >= 0, 1.0, -1.0)[:, None]  # velocities are those of the second
        rows = contact.efc_address[which, None] + ROWS
        return which, feet[which].max(axis=1, initial=-1), sign, rows


BATCH_S = 0.008
"""Longest period of motors and hand, s."""
HEAT_S = 0.032
"""Period of supply and heat, s."""
LONGEST_S = 60.0
"""Longest time of one `advance`, s: the rest is skipped."""
MAX_WAITING = 1000
"""Most goals that wait for their time."""
STEP_ROUNDING = 1e-6  # of a step
FRICTION_SPREAD = 0.1
"""Share by which the friction of two servos of a type differs."""


class Simulation:
    """A simulated robot. data: of the engine. hand: None on a stand or gantry. moves: the mechanics run, from the first
    torque on."""

    def __init__(self, world: World, *, perturbation: Perturbation, seed: int) -> None:
        mujoco = engine()
        self.world = world
        self.perturbation, self.seed = perturbation, seed
        self._model = model = world.model
        chance = np.random.default_rng(seed)
        self.motors = Motors(model, world.drives)
        factors = 1.0 + FRICTION_SPREAD * chance.uniform(-1.0, 1.0, len(world.drives))
        for drive, factor in zip(world.drives, factors, strict=True):
            if drive.servo.coupling is None:
                model.dof_frictionloss[model.joint(drive.servo.joint).dofadr[0]] *= factor
            else:
                model.tendon_frictionloss[model.tendon(SHAFT + drive.servo.joint).id] *= factor
        # The masses of the robot's links; the world and what is fixed to it weigh nothing that matters.
        links = slice(world.root, None)
        model.body_mass[links] *= perturbation.mass_scale
        model.body_inertia[links] *= perturbation.mass_scale
        total = model.body_mass[links].sum()
        model.body_ipos[world.root] += np.array(perturbation.com_offset) * total / model.body_mass[world.root]
        self.data: Any = mujoco.MjData(model)
        if world.mount.support is Support.GANTRY:
            damp_swinging(model, world.weight)
        mujoco.mj_setConst(model, self.data)
        mujoco.mj_resetData(model, self.data)
        self.data.qpos[:] = world.start
        within = chance.uniform(-0.5, 0.5, len(world.drives))  # where in its tick each shaft begins
        for drive, share in zip(world.drives, within, strict=True):
            if drive.servo.coupling is None:
                address = model.joint(drive.servo.joint).qposadr[0]
                self.data.qpos[address] += share * drive.servo.model.tick_rad / drive.servo.gear
        mujoco.mj_forward(model, self.data)
        self._steps = SoleSteps(model, self.data)
        self.hand = Hand(model, self.data, world.root) if world.mount.support is Support.FLOOR else None
        self.electrics = Electrics(world.drives)
        self.motors.goal = self.motors.angle(self.data)
        self._switched_on: BoolArray = np.zeros(len(world.drives), dtype=np.bool_)
        self._waiting: deque[tuple[int, FloatArray]] = deque()
        self._done = self._heated = self._heat_due = 0  # steps
        self._pushes = [(self._count(push.start), self._count(push.end), push) for push in perturbation.pushes]
        self.moves = False

    @property
    def time(self) -> float:
        """Time of the engine, s since the start."""
        return self._done * self.world.step

    @property
    def held(self) -> bool:
        """True while a hand holds the robot."""
        return self.hand is not None and self.hand.holding

    def aim(self, angles: FloatArray, at: float) -> None:
        """Set goals `angles` (n,) rad from the time `at` on, s, plus the latency of the perturbation."""
        if len(self._waiting) < MAX_WAITING:
            self._waiting.append((self._count(at + self.perturbation.latency_s), angles))

    def settle_goals(self) -> None:
        """Apply all goals that wait for their time."""
        if self._waiting:
            self.motors.goal = self._waiting[-1][1]
            self._waiting.clear()

    def switch(self, on: BoolArray) -> None:
        """Switch torque `on` (n,) or off. A servo with an alert stays off."""
        self._switched_on = on & (self.electrics.alert == 0)
        self.motors.power(self._switched_on, self.electrics.voltage)
        if self._switched_on.any():
            self.moves = True
            if self.hand is not None:
                self.hand.let_go(self.time)

    def advance(self, to: float) -> None:
        """Go on to the time `to`, s; an earlier time changes nothing. Raises BusError if it diverges."""
        end = self._count(to)
        if end - self._done > self._count(LONGEST_S):
            self._done = end - self._count(LONGEST_S)
        while self._done < end:
            while self._waiting and self._waiting[0][0] <= self._done:
                self.motors.goal = self._waiting.popleft()[1]
            steps = min(self._next_event(), end) - self._done
            elapsed = steps * self.world.step
            if self.moves:
                self._run(steps, elapsed)
            self._done += steps
            if self._done >= self._heat_due:  # a servo with an alert loses its torque
                passed = (self._done - self._heated) * self.world.step
                self._heated = self._done
                self._heat_due = self._done + self._count(HEAT_S)
                torque, speed = self.motors.torque(self.data), self.motors.speed(self.data)
                if self.electrics.advance(torque, speed, self.motors.driven, passed):
                    self._switched_on &= self.electrics.alert == 0
                    self.motors.power(self._switched_on, self.electrics.voltage)

    def push(self, push: Push) -> None:
        """Push the robot, at times since the start."""
        self._pushes.append((self._count(push.start), self._count(push.end), push))

    def _run(self, steps: int, elapsed: float) -> None:
        self.motors.command(self.data, elapsed)
        if self.hand is not None:
            self.hand.ease(self.time)
        if self._pushes:
            self._apply_pushes()
        self._steps.take(steps)
        if not isfinite(self.data.qvel.sum()):
            self.moves = False
            raise BusError(
                describe(
                    what="the simulation has diverged",
                    where=f"physics, {self.time:.3f} s",
                    then="Look at the masses, inertias and gains of this robot: one of them is far off",
                )
            )

    def _count(self, time: float) -> int:
        return floor(time / self.world.step + STEP_ROUNDING)

    def _next_event(self) -> int:
        event = self._done + max(self._count(BATCH_S), 1)
        if self._waiting:
            event = min(event, self._waiting[0][0])
        for start, end, _ in self._pushes:
            for edge in (start, end):
                if self._done < edge < event:
                    event = edge
        return event

    def _apply_pushes(self) -> None:
        self.data.xfrc_applied[:] = 0.0
        for start, end, push in self._pushes:
            if not start <= self._done < end:
                continue
            force, link, data = np.array(push.force), self.world.root, self.data
            point = data.xipos[link]
            if push.frame is not None:
                frame = self.world.robot.frame(push.frame)
                link = self._model.body(self.world.robot.body.body_names[frame.body]).id
                point = data.xpos[link] + data.xmat[link].reshape(3, 3) @ frame.position
            data.xfrc_applied[link, :3] += force
            data.xfrc_applied[link, 3:] += np.cross(point - data.xipos[link], force)
