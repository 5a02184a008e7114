"""What the engine leaves out of its contacts: the acceleration that a sole would have of the speeds of the body alone.

A point with Jacobian J accelerates by J dv/dt + dJ/dt v. MuJoCo asks for a reference acceleration -b J v of the first
part only, so a sole that is stuck to the floor creeps by dJ/dt v / b while the legs above it move: 3 mm/s under an OP3
that boxes, whatever the friction (b: 337 per second with contacts of 6 ms). Here the second part is taken off the
reference before forces are found, and what is stuck stays.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardware.arrays import FloatArray
from retarget.body_file import engine
from sim.physics.ground import SOLE

__all__ = ["SoleSteps"]

ROWS = np.arange(3)  # of a contact: its normal and two tangents


class SoleSteps:
    """Steps of the engine in which the corners of soles are held where they touch."""

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
        """Go on by so many, few enough that a body moves on little: the correction is found at the first, and where
        contacts change."""
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
        """Take dJ/dt v off the reference accelerations of all corners that touch; find it anew if it is due."""
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
        """dJ/dt v of the corners that touch, (c, 3) m/s^2 along the rows of their contacts."""
        data, contact = self._data, self._data.contact
        which, foot, sign, _ = self._contacts
        change, velocity = self._change, data.qvel
        for index, body in enumerate(self._feet):
            self._jacobian(self._model, data, change[:3], change[3:], data.xpos[body], body)
            np.matmul(change, velocity, out=self._bias[index])
        bias = self._bias[foot]
        x, y, z = (contact.pos[which] - data.xpos[self._feet][foot]).T
        turn_x, turn_y, turn_z = bias[:, 3:].T
        acceleration = bias[:, :3]
        acceleration[:, 0] += turn_y * z - turn_z * y
        acceleration[:, 1] += turn_z * x - turn_x * z
        acceleration[:, 2] += turn_x * y - turn_y * x
        frames = contact.frame[which].reshape(-1, 3, 3)
        return np.asarray(sign * (frames @ acceleration[:, :, None])[:, :, 0])

    def _sorted(self) -> tuple[NDArray[np.intp], NDArray[np.intp], FloatArray, NDArray[np.intp]]:
        """The contacts (c,) of corners of soles: which, of which foot, on which side (c, 1), 1 or -1, and their rows
        (c, 3)."""
        contact = self._data.contact
        feet = self._foot[contact.geom].reshape(-1, 2)
        which = np.flatnonzero((feet.max(axis=1, initial=-1) >= 0) & (contact.efc_address >= 0))
        sign = np.where(feet[which, 1] >= 0, 1.0, -1.0)[:, None]  # velocities are those of the second
        rows = contact.efc_address[which, None] + ROWS
        return which, feet[which].max(axis=1, initial=-1), sign, rows
