"""Where every link of a body is over a motion, and how fast."""

from dataclasses import dataclass

import numpy as np

from retarget.exporting.motion import Motion
from retarget.rotations import FloatArray, conjugate, log, multiply

__all__ = ["Links", "angular_velocity", "links_of", "rate_of_change"]


@dataclass(frozen=True, eq=False)
class Links:
    """Links (b) in the order of the body file, without the world. position (T, b, 3) m and orientation (T, b, 4) wxyz
    of their origins, world."""

    names: tuple[str, ...]
    position: FloatArray
    orientation: FloatArray


def links_of(motion: Motion) -> Links:
    """Forward kinematics of all rows."""
    body = motion.body
    numbers = list(range(1, len(body.body_names)))
    solver, q = body.solver_body(), np.ascontiguousarray(motion.q)
    position = solver.points(q, numbers, np.zeros((len(numbers), 3)))
    return Links(body.body_names[1:], position, solver.orientations(q, numbers))


def rate_of_change(values: FloatArray, rate_hz: float) -> FloatArray:
    """Central differences over the rows (T, ...), per second; one-sided at both ends, 0 for a single row."""
    return np.asarray(np.gradient(values, axis=0) * rate_hz if len(values) > 1 else np.zeros_like(values))


def angular_velocity(orientation: FloatArray, rate_hz: float) -> FloatArray:
    """World angular velocities (T, ..., 3) rad/s of orientations (T, ..., 4), by differences as `rate_of_change`."""
    if len(orientation) < 2:
        return np.zeros((*orientation.shape[:-1], 3))
    rows = np.arange(len(orientation))
    before, after = np.maximum(rows - 1, 0), np.minimum(rows + 1, len(orientation) - 1)
    turn = log(multiply(orientation[after], conjugate(orientation[before])))
    seconds = (after - before) / rate_hz
    return np.asarray(turn / seconds.reshape(-1, *[1] * (turn.ndim - 1)))
