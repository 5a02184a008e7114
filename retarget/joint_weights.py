"""One number per degree of freedom, by the names that people use in a priority file."""

from collections.abc import Iterable

import numpy as np

from retarget.body import BodyModel, JointType
from retarget.errors import ConfigError, suggest
from retarget.rotations import FloatArray

__all__ = ["joint_weights"]


def joint_weights(body: BodyModel, values: Iterable[tuple[str, float]], *, default: float) -> FloatArray:
    """One number per DoF (nv,): that of the last pair that names it, else `default`; for a free root else 0.

    A name is a DoF (`l_knee_flexion`), a DoF of both sides (`knee_flexion`), a joint (`l_hip`), or a joint of both
    sides (`hip`); `root` is the six of a free root. Raises ConfigError with the nearest names.
    """
    result = np.full(body.nv, default)
    for start, kind in zip(body.joint_dof, body.joint_type, strict=True):
        if kind == JointType.FREE:
            result[start : start + 6] = 0.0
    aliases = [_aliases(name) for name in body.dof_names]
    for key, value in values:
        chosen = [i for i, names in enumerate(aliases) if key in names]
        if not chosen:
            known = sorted(set().union(*aliases))
            raise ConfigError("unknown joint", where=body.source, found=key, next_step=suggest(key, known))
        result[chosen] = value
    return result


def _aliases(dof: str) -> set[str]:
    """Names of a DoF: its own, without the side, and its joint's, with and without the side."""
    unsided = dof[2:] if dof[:2] in ("l_", "r_") else dof
    return {dof, unsided, dof.rsplit("_", 1)[0], unsided.rsplit("_", 1)[0]}
