"""Arguments of `retarget.ik`: each check returns a usable value or raises UsageError."""

from collections.abc import Iterable, Mapping
from math import inf

import numpy as np

from hardware.errors import counted
from retarget.errors import Problem, UsageError
from retarget.model.body import BodyModel, Frame, JointType
from retarget.types import FloatArray

ROUNDING = 1e-9  # [rad, m] a posture may be this far beyond a joint's range, as it was rounded


def vector(given: object, size: int, where: str) -> FloatArray:
    """Finite numbers (size,)."""
    value = _array(given)
    fault = _fault(value, value is not None and value.shape == (size,))
    if value is None or fault:
        raise UsageError(fault, where=where, found=_shown(given), allowed=counted(size, "finite number"))
    return value


def weight(given: object, where: str) -> tuple[float, float, float]:
    """Weights of three rows."""
    x, y, z = vector(given, 3, where).tolist()
    if min(x, y, z) < 0.0:
        raise UsageError("a negative weight", where=where, found=_shown(given), allowed="0 and above")
    return x, y, z


def limit(given: object, body: BodyModel, where: str) -> FloatArray:
    """A limit of each DoF (nv,), infinite where there is none."""
    value = _array(given)
    fits = value is not None and value.shape in ((), (body.nv,))
    if value is None or not fits or not (value > 0.0).all():
        fault = "out of range" if fits else _fault(value, fits)
        allowed = f"one number above 0, or {body.nv} of them in the order of `body.dof_names`"
        raise UsageError(fault, where=where, found=_shown(given), allowed=allowed)
    return np.full(body.nv, value)


def positive(given: object, where: str, unit: str = "", most: float = inf) -> float:
    """A finite number above 0, at most `most`."""
    value = _array(given)
    is_number = value is not None and value.shape == ()
    if value is None or not is_number or not 0.0 < value <= most or value == inf:
        allowed = "a number above 0" + (f", at most {most:g}" if most < inf else "") + (f", {unit}" if unit else "")
        fault = "out of range" if is_number else "not a number"
        raise UsageError(fault, where=where, found=_shown(given), allowed=allowed)
    return float(value)


def whole(given: object, where: str, most: int) -> int:
    """A whole number from 1 to `most`."""
    allowed = f"a whole number from 1 to {most}"
    if not isinstance(given, int | np.integer) or isinstance(given, bool):
        raise UsageError("not a whole number", where=where, found=_shown(given), allowed=allowed)
    if not 1 <= given <= most:
        raise UsageError("out of range", where=where, found=_shown(given), allowed=allowed)
    return int(given)


def names(given: object, where: str, of: str) -> tuple[str, ...]:
    """A list of names `of` something."""
    if isinstance(given, Iterable) and not isinstance(given, str):
        listed = tuple(given)
        if all(isinstance(name, str) for name in listed):
            return listed
    raise UsageError("not a list of names", where=where, found=_shown(given), allowed=f"a list of names of {of}")


def check_mapping(given: object, where: str, allowed: str) -> None:
    """Refuse any other type than a mapping."""
    if not isinstance(given, Mapping):
        raise UsageError("not a mapping", where=where, found=_shown(given), allowed=allowed)


def frame(body: BodyModel, name: object, where: str) -> Frame:
    """A site or a link of a body. Raises ConfigError for an unknown name."""
    if not isinstance(name, str):
        raise UsageError("not a name", where=where, found=_shown(name), allowed="the name of a site or a link")
    return body.frame(name)


def half_spaces(given: object, most: int, where: str) -> FloatArray:
    """Rows (n, 4) of nx, ny, nz, d with normals of length 1. n may be 0."""
    rows = _array(given)
    if rows is not None and rows.shape == (0,):
        rows = rows.reshape(0, 4)
    fault = _fault(rows, rows is not None and rows.ndim == 2 and rows.shape[1] == 4)
    if rows is not None and not fault:
        long = np.sqrt(np.square(rows[:, :3]).sum(axis=1))
        if len(rows) > most:
            fault = "too many rows"
        elif not (np.abs(long - 1.0) < 1e-6).all():
            fault = "a normal that is not of length 1"
    if rows is None or fault:
        allowed = f"shape (n, 4), up to {counted(most, 'row')} nx, ny, nz, d, n of length 1"
        raise UsageError(fault, where=where, found=_shown(given), allowed=allowed)
    return rows


def posture(given: object, body: BodyModel, where: str) -> FloatArray:
    """A posture (nq,) within the range of every hinge and slide."""
    q = vector(given, body.nq, where)
    problems = []
    for name, kind, at, dof in zip(body.joint_names, body.joint_type, body.joint_qpos, body.joint_dof, strict=True):
        if kind not in (JointType.HINGE, JointType.SLIDE):
            continue
        lower, upper = body.lower[dof], body.upper[dof]
        if not lower - ROUNDING <= q[at] <= upper + ROUNDING:
            unit = "rad" if kind == JointType.HINGE else "m"
            allowed = f"{lower:.6g} to {upper:.6g} {unit}"
            step = "Give a posture within the ranges of the joints"
            problems.append(Problem("a joint is beyond its range", where, f"{name} at {q[at]:.6g}", allowed, step))
    if problems:
        raise UsageError.from_problems(problems)
    return q


def _array(given: object) -> FloatArray | None:
    try:
        value = np.array(given)
    except (TypeError, ValueError):  # rows of different lengths
        return None
    return value.astype(np.float64) if value.dtype.kind in "iuf" else None


def _fault(value: FloatArray | None, fits: bool) -> str:
    if value is None:
        return "not numbers"
    if not fits:
        return "numbers of a wrong shape"
    return "" if np.isfinite(value).all() else "numbers that are not finite"


def _shown(given: object) -> str:
    return f"{given!r:.80}"
