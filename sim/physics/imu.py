"""The true motion of a sensor on a link of a simulated robot."""

from typing import Any

import numpy as np

from hardware.imu import STANDARD_GRAVITY, ImuSpec
from retarget.model.body_file import engine
from sim.imu import ImuTruth
from sim.physics.simulation import Simulation


class LinkMotion:
    """The motion of a sensor. It does not change the state of the engine."""

    def __init__(self, simulation: Simulation, spec: ImuSpec) -> None:
        mujoco = engine()
        self._simulation, self._model = simulation, simulation.world.model
        self._link, self._arm = int(self._model.body(spec.link).id), np.array(spec.position)
        self._kind: Any = mujoco.mjtObj.mjOBJ_XBODY
        self._velocity, self._acceleration = mujoco.mj_objectVelocity, mujoco.mj_objectAcceleration
        self._accelerations = mujoco.mj_rnePostConstraint
        self._found = np.zeros(6)

    def __call__(self) -> ImuTruth:
        """The motion after the last step of the engine."""
        simulation, data, found = self._simulation, self._simulation.data, self._found
        w, x, y, z = data.xquat[self._link].tolist()
        if not simulation.moves:  # a hand, a stand or a rope holds it
            up = STANDARD_GRAVITY * data.xmat[self._link].reshape(3, 3)[2]
            return ImuTruth((w, x, y, z), (0.0, 0.0, 0.0), (up[0], up[1], up[2]))
        self._velocity(self._model, data, self._kind, self._link, found, 1)
        turn = found[:3].copy()
        self._accelerations(self._model, data)
        self._acceleration(self._model, data, self._kind, self._link, found, 1)
        # a + alpha x r + omega x (omega x r). The engine counts gravity as an acceleration upwards.
        arm = self._arm
        force = found[3:] + np.cross(found[:3], arm) + np.cross(turn, np.cross(turn, arm))
        return ImuTruth((w, x, y, z), tuple(turn.tolist()), tuple(force.tolist()))
