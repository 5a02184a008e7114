"""The geoms of a body over many postures: where each is, and how far it went."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.rotations import FloatArray

__all__ = ["MovingGeoms", "moving_geoms", "travelled"]


@dataclass(frozen=True, eq=False)
class MovingGeoms:
    """g geoms in T postures. links (g,): numbers of their links; geoms (g,): their own numbers in the model.

    position (T, g, 3) m and matrix (T, g, 9), world, rows of the rotation one after the other; radius (g,) m of a ball
    about the position that holds the geom.
    """

    links: NDArray[np.int64]
    geoms: NDArray[np.int64]
    position: FloatArray
    matrix: FloatArray
    radius: FloatArray

    def chosen(self, rows: NDArray[np.int64], which: NDArray[np.int64]) -> "MovingGeoms":
        """Some of the geoms in some of the postures, by number."""
        return MovingGeoms(
            self.links[which],
            self.geoms[which],
            self.position[rows][:, which],
            self.matrix[rows][:, which],
            self.radius[which],
        )

    def within(self, base: int) -> "MovingGeoms":
        """The same, seen from the geom `base`, whose own motion then takes no part."""
        back = self.matrix[:, base].reshape(-1, 1, 3, 3).swapaxes(-1, -2)  # R_base_world
        position = (back @ (self.position - self.position[:, base, None])[..., None])[..., 0]
        matrix = back @ self.matrix.reshape(*self.matrix.shape[:2], 3, 3)
        return MovingGeoms(self.links, self.geoms, position, matrix.reshape(self.matrix.shape), self.radius)


def moving_geoms(model: Any, postures: FloatArray) -> MovingGeoms:
    """The geoms of every link of a compiled body, but not those of the world, in postures (T, nq)."""
    import mujoco

    data = mujoco.MjData(model)
    chosen = np.flatnonzero(np.asarray(model.geom_bodyid) > 0)
    position, matrix = np.empty((len(postures), model.ngeom, 3)), np.empty((len(postures), model.ngeom, 9))
    q, at, turned, kinematics = data.qpos, data.geom_xpos, data.geom_xmat, mujoco.mj_kinematics
    for row, posture in enumerate(postures):
        q[:] = posture
        kinematics(model, data)
        position[row] = at
        matrix[row] = turned
    return MovingGeoms(
        links=np.asarray(model.geom_bodyid)[chosen].astype(np.int64),
        geoms=chosen,
        position=position[:, chosen],
        matrix=matrix[:, chosen],
        radius=np.asarray(model.geom_rbound)[chosen].copy(),
    )


def travelled(position: FloatArray, matrix: FloatArray, radius: FloatArray) -> FloatArray:
    """Upper bound (T, g) m of the way that any point of each geom went since the first posture.

    Between two postures no point goes farther than |c1 - c0| + r ||R1 - R0||, and ||R1 - R0|| is the Frobenius norm
    over sqrt(2): both singular values of the difference of two rotations that are not zero are equal.
    """
    shift = np.linalg.norm(np.diff(position, axis=0), axis=-1)
    turn = np.sqrt(0.5) * np.linalg.norm(np.diff(matrix, axis=0), axis=-1)
    return np.vstack([np.zeros((1, position.shape[1])), np.cumsum(shift + radius * turn, axis=0)])
