"""Figures of a motion: joint limits, balance, observer activity, and simulated mechanics."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from retarget import rotations
from retarget.ik.gravity_torque import GRAVITY
from retarget.model.body import JointLimits
from retarget.model.human import human_limits
from retarget.model.robot import RobotBody
from retarget.robot.arm_branches import chain_to_anchor
from retarget.run.record import Record
from retarget.run.run_result import RunResult
from retarget.types import MM, BoolArray, FloatArray

BLOCK = 256
"""Rows that are measured together: 35 MB for the distances of all observer pairs."""

Array = TypeVar("Array", bound=NDArray[np.generic])


def blocks(count: int) -> Iterator[slice]:
    """Yield the slice of each block of `count` rows; one empty slice for no rows."""
    for first in range(0, max(count, 1), BLOCK):
        yield slice(first, min(first + BLOCK, count))


def in_blocks(measured: Callable[[slice], Array], count: int) -> Array:
    """The results (count, ...) of `measured` for slices of `count` rows."""
    return in_named_blocks(lambda rows: {"": measured(rows)}, count)[""]


def in_named_blocks(measured: Callable[[slice], Mapping[str, Array]], count: int) -> dict[str, Array]:
    """Like `in_blocks`, for several arrays by name."""
    whole: dict[str, Array] = {}
    for rows in blocks(count):
        for name, part in measured(rows).items():
            if name not in whole:  # filled in place: parts that are joined at the end need twice the memory
                whole[name] = np.empty((count, *part.shape[1:]), part.dtype)  # type: ignore[assignment]
            whole[name][rows] = part
    return whole


TOLERANCE = 1e-8
"""Round-off, rad or m, of a position or a displacement beyond its limit; twice this for a change of displacement."""


@dataclass(frozen=True, eq=False)
class MovedJoints:
    """The joints that a run moves: positions (T, n) that were sent, rad or m; limits (n,); dt, s. A human has its free
    joints."""

    names: tuple[str, ...]
    positions: FloatArray
    limits: JointLimits
    dt: float


def moved_joints(run: RunResult) -> MovedJoints:
    """The joints that a run moves."""
    robot, sent = run.robot, run.record.robot
    if robot is not None and sent is not None:
        return MovedJoints(robot.joint_map.joints, sent.q[:, robot.servo_columns], robot.limits, run.clip.dt)
    body, whole = run.human.body, human_limits(run.human.body)
    single, address = body.scalar_joints()
    free = single & ~run.human.locked
    limits = JointLimits(whole.lower[free], whole.upper[free], whole.max_velocity[free], whole.max_acceleration[free])
    names = tuple(name for name, kept in zip(body.dof_names, free, strict=True) if kept)
    return MovedJoints(names, run.record.human_q[:, address[free]], limits, run.clip.motion_dt)


@dataclass(frozen=True)
class LimitViolations:
    """Number of values beyond a limit, over all joints and ticks."""

    position: int
    velocity: int
    acceleration: int


def limit_violations(
    positions: FloatArray, limits: JointLimits, dt: float, *, from_rest: bool = True, to_rest: bool = False
) -> LimitViolations:
    """Count violations in joint positions (T, n), `dt` s apart.

    from_rest, to_rest: the motion begins, or ends, at rest; otherwise the first displacement has no acceleration. A
    joint that begins beyond a position limit counts only after it was inside.
    """
    counts = np.zeros(3, dtype=np.int64)
    for joint, track in enumerate(positions.T):  # one by one: a run is long, and each step of this is as large as it
        step = np.diff(track)  # (T-1,) [rad or m]
        before = np.zeros_like(step[:1]) if from_rest else step[:1]
        after = np.zeros_like(step[:1] if to_rest else step[:0])
        outside, fast, hard = _beyond(track, np.concatenate([before, step, after]), limits, joint, dt, TOLERANCE)
        came_in = np.logical_or.accumulate(~outside)
        begin, end = len(before), len(before) + len(step)
        counts += (np.count_nonzero(outside & came_in), np.count_nonzero(fast[begin:end]), np.count_nonzero(hard))
    return LimitViolations(*counts.tolist())


def _beyond(
    track: FloatArray, step: FloatArray, limits: JointLimits, joint: int, dt: float, tolerance: float
) -> tuple[BoolArray, BoolArray, BoolArray]:
    return (
        (track < limits.lower[joint] - tolerance) | (track > limits.upper[joint] + tolerance),
        np.abs(step) > limits.max_velocity[joint] * dt + tolerance,
        np.abs(np.diff(step)) > limits.max_acceleration[joint] * dt**2 + 2.0 * tolerance,
    )


@dataclass(frozen=True)
class BeyondLimit:
    """share: ticks with any joint beyond its limit. joint, joint_share: the most frequent one."""

    share: float
    joint: str | None
    joint_share: float


def beyond_limits(
    names: tuple[str, ...], positions: FloatArray, limits: JointLimits, dt: float, *, tolerance: float
) -> dict[str, BeyondLimit]:
    """Violations of limits of `position`, `velocity` and `acceleration`, for positions (T, n) cut from a motion, T at
    least 3. tolerance: of the file."""
    by_joint = [_beyond(track, np.diff(track), limits, joint, dt, tolerance) for joint, track in enumerate(positions.T)]
    found = {}
    for kind, flags in zip(("position", "velocity", "acceleration"), zip(*by_joint, strict=True), strict=True):
        shares = [float(of_joint.mean()) for of_joint in flags]
        worst = int(np.argmax(shares))
        whole = float(np.any(flags, axis=0).mean())
        found[kind] = BeyondLimit(whole, names[worst] if shares[worst] else None, shares[worst])
    return found


@dataclass(frozen=True)
class Nearest:
    """The joint that used most of its limit. value, limit: rad (or m) and s."""

    joint: str
    value: float
    limit: float

    @property
    def share(self) -> float:
        """Used share of the limit."""
        return self.value / self.limit


@dataclass(frozen=True)
class LimitUse:
    """Use of joint limits, None if unknown. room: the joint nearest to a position limit, and its distance, rad (or m),
    negative beyond."""

    room: tuple[str, float] | None
    velocity: Nearest | None
    acceleration: Nearest | None


def limited_positions(run: RunResult) -> FloatArray:
    """Joint positions (T, n) that keep limits: the goals of a robot, from the one before; the postures of a human, or
    of a walking robot, whose offset has its own bound."""
    moved, sent = moved_joints(run).positions, run.record.robot
    return moved if sent is None else np.vstack([sent.start, sent.goals if run.tally.walk is None else moved])


def limit_use(run: RunResult) -> LimitUse:
    """The use of limits, by finite differences."""
    moved = moved_joints(run)
    names, limits, dt, positions = moved.names, moved.limits, moved.dt, limited_positions(run)
    if len(positions) < 3 or not names:
        return LimitUse(None, None, None)
    room, fastest, hardest = np.zeros((3, len(names)))
    for joint, track in enumerate(positions.T):  # one by one: of a long run each step of this is as large as it
        step = np.diff(track)
        room[joint] = np.minimum(track - limits.lower[joint], limits.upper[joint] - track).min()
        fastest[joint], hardest[joint] = np.abs(step).max() / dt, np.abs(np.diff(step)).max() / dt**2
    near = int(np.argmin(room))
    return LimitUse(
        room=(names[near], float(room[near])) if np.isfinite(room[near]) else None,
        velocity=_nearest(names, fastest, limits.max_velocity),
        acceleration=_nearest(names, hardest, limits.max_acceleration),
    )


@dataclass(frozen=True)
class HeldBack:
    """A limb that one limit restrains. limb: "left arm", ...; by: the joint at its position limit, or the observer in
    contact; limit_deg: null for an observer; share: of the ticks."""

    limb: str
    by: str
    limit_deg: float | None
    share: float

    @property
    def words(self) -> str:
        """The limb and its limit, in words."""
        by = f"observer {self.by}" if self.limit_deg is None else f"{self.by} at its limit of {self.limit_deg:.0f}°"
        return f"the {self.limb} is held back by {by} in {self.share:.0%} of ticks"


HELD_BACK, AT_LIMIT = 0.5, 1e-3
"""Share of ticks in which a limit restrains a limb, and distance, rad, of a joint that is at its limit."""
PROBE_RAD, NEARER_M = 0.1, 1e-3
"""A joint at a limit restrains the limb if PROBE_RAD beyond it the landmarks are nearer to their targets by NEARER_M in
all."""
LIMB_OF = {"l_hand": "left arm", "r_hand": "right arm", "l_sole": "left leg", "r_sole": "right leg"}
"""The limb that ends at a landmark."""


def held_back(run: RunResult) -> tuple[HeldBack, ...]:
    """The limit that restrains each limb of a robot most, from `HELD_BACK` on, by falling share."""
    robot, sent, rows = run.robot, run.record.robot, run.record.following
    if robot is None or sent is None or not run.ticks_followed:
        return ()
    body, found = robot.body, list[HeldBack]()
    for landmark in (name for name in LIMB_OF if name in robot.profile.landmarks):
        limb, chain = LIMB_OF[landmark], list(chain_to_anchor(robot, landmark))
        tried = []
        for column, joint in enumerate(robot.joint_map.joints):
            if body.joint_index(joint) in chain:
                tried += [HeldBack(limb, joint, *_at_limit(robot, sent, rows, column, sign)) for sign in (-1.0, 1.0)]
        for column, name in enumerate(run.observer_names):
            if run.observers is not None and run.observers.links[column] in body.joint_body[chain]:
                share = float((sent.observer_modes[rows, column] == REACTIVE).mean())
                tried.append(HeldBack(limb, name, None, share))
        worst = max(tried, key=attrgetter("share"), default=None)
        found += [worst] if worst is not None and worst.share >= HELD_BACK else []
    return tuple(sorted(found, key=attrgetter("share"), reverse=True))


def _at_limit(robot: RobotBody, sent: Record, rows: slice, column: int, sign: float) -> tuple[float, float]:
    """A limit of a servo's joint, degrees, and the share of `rows` in which it restrains the limb. sign: -1 lower, 1
    upper."""
    limit = float((robot.limits.lower if sign < 0.0 else robot.limits.upper)[column])
    at = sign * (limit - sent.goals[rows, column]) < AT_LIMIT
    if at.mean() < HELD_BACK:
        return float(np.rad2deg(limit)), 0.0
    frames, desired = robot.landmark_frames(sent.landmark_names), sent.landmarks_asked[rows][at]

    def off(by: float) -> FloatArray:
        q = sent.q[rows][at]
        q[:, robot.servo_columns[column]] += by
        return np.asarray(np.linalg.norm(robot.points(q, frames) - desired, axis=2).sum(axis=1))

    return float(np.rad2deg(limit)), float((off(0.0) - off(sign * PROBE_RAD) > NEARER_M).sum() / len(at))


def _nearest(names: tuple[str, ...], values: FloatArray, limits: FloatArray) -> Nearest | None:
    share = values / np.where(limits > 0.0, limits, np.inf)
    joint = int(np.argmax(share))
    return Nearest(names[joint], float(values[joint]), float(limits[joint])) if np.isfinite(limits[joint]) else None


def jerk_p95(positions: FloatArray, dt: float) -> float | None:
    """95th percentile of the jerk of joint positions (T, n), rad/s^3; None for fewer than four ticks."""
    if len(positions) < 4 or positions.shape[1] == 0:
        return None
    sizes = np.empty((positions.shape[1], len(positions) - 3))
    for joint, track in enumerate(positions.T):
        np.abs(np.diff(track, n=3), out=sizes[joint])
    return float(np.percentile(sizes, 95, overwrite_input=True) / dt**3)


SHAKE_HZ = 6.0
"""Filter frequency of human movement analysis, Hz (Winter, Biomechanics of Human Movement, 2009)."""


def shake_share(positions: FloatArray, dt: float) -> float | None:
    """Share of the power of joint speeds above `SHAKE_HZ`. positions (T, n) rad. None for too few rows, or no
    motion."""
    if 0.5 / dt <= SHAKE_HZ or len(positions) * dt < 2.0 / SHAKE_HZ:
        return None
    speeds = np.diff(positions, axis=0)
    power = np.abs(np.fft.rfft(speeds * np.hanning(len(speeds))[:, None], axis=0)) ** 2
    whole = float(power.sum())
    high = np.fft.rfftfreq(len(speeds), dt) > SHAKE_HZ
    return float(power[high].sum()) / whole if whole > 1e-12 else None


CONTACT_M = 0.005
"""Height, m, above the ground z = 0 up to which a corner of a sole supports."""
OUTSIDE_M = 1e-4
"""Distance, m, of a centre of mass that is outside the support polygon."""
_DIRECTIONS = np.deg2rad(np.arange(0.0, 360.0, 2.0))  # [rad] in which the edge is looked for


def tilt(orientation: FloatArray) -> FloatArray:
    """Angle (...) rad from the vertical of the z axis of a frame with orientation (..., 4) wxyz."""
    upward = rotations.rotate(orientation, np.array([0.0, 0.0, 1.0]))
    return np.asarray(np.arccos(np.clip(upward[..., 2], -1.0, 1.0)))


def support_margin(centre_of_mass: FloatArray, corners: FloatArray) -> FloatArray:
    """Distance (T,) m of the centre of mass (T, 3) inside the convex hull of the touching corners (T, c, 3); negative
    outside, NaN without touch. Tangents of the hull every 2 degrees are exact to 0.02 % of its size."""
    touching = corners[..., 2] <= CONTACT_M  # (T, c)
    directions = np.stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)])
    farthest = np.full((len(corners), _DIRECTIONS.size), -np.inf)
    for corner in range(corners.shape[1]):
        offset = corners[:, corner, :2] - centre_of_mass[:, :2]
        offset[~touching[:, corner]] = np.nan
        np.fmax(farthest, offset @ directions, out=farthest)
    margin = farthest.min(axis=1)
    return np.asarray(np.where(touching.any(axis=1), margin, np.nan))


AT_REST_M, STEP_M = 2e-5, 2e-3
"""Motion in one tick, m, of a sole at rest, and distance, m, of a step."""


@dataclass(frozen=True, eq=False)
class Standing:
    """A robot on k soles in T postures: com (T, 3) m; margin (T,) m; place (T, k, 3) m and tilt (T, k) rad; corners (T,
    c, 3) m, `sizes` for each sole."""

    com: FloatArray
    margin: FloatArray
    place: FloatArray
    tilt: FloatArray
    corners: FloatArray
    sizes: tuple[int, ...]

    @property
    def soles(self) -> list[FloatArray]:
        """Corners (T, c, 3) m of each sole, world."""
        return np.split(self.corners, np.cumsum(self.sizes)[:-1], axis=1)

    def footprints(self) -> list[FloatArray]:
        """Corners (c, 3) m of each sole, world, at the start and after each step."""
        found = list[FloatArray]()
        for sole in self.soles:
            last = sole[0]
            found.append(last)
            rests = np.abs(np.diff(sole, axis=0)).max(axis=(1, 2)) < AT_REST_M
            for row in np.flatnonzero(rests[1:] & ~rests[:-1]) + 2:
                if np.abs(sole[row] - last).max() > STEP_M and sole[row, :, 2].max() < STEP_M:
                    last = sole[row]
                    found.append(last)
        return found

    @property
    def outside(self) -> BoolArray:
        """True (T,) where the centre of mass has no support."""
        return np.asarray(~(self.margin >= -OUTSIDE_M))


def standing_of(robot: RobotBody, q: FloatArray) -> Standing:
    """A robot on its soles, in postures (T, nq)."""
    feet = list(robot.profile.feet.values())
    frames, sizes = tuple(foot.frame for foot in feet), tuple(len(foot.polygon) for foot in feet)
    local = np.column_stack([np.concatenate([foot.polygon for foot in feet]), np.zeros(sum(sizes))])
    of = np.repeat(np.arange(len(feet)), sizes)

    def measured(rows: slice) -> dict[str, FloatArray]:
        place, turn = robot.points(q[rows], frames), robot.orientations(q[rows], frames)
        corners = place[:, of] + rotations.rotate(turn[:, of], local)
        com = robot.body.solver_body().centre_of_mass(np.ascontiguousarray(q[rows]))
        margin = support_margin(com, corners)
        return {"com": com, "margin": margin, "place": place, "tilt": tilt(turn), "corners": corners}

    return Standing(**in_named_blocks(measured, len(q)), sizes=sizes)


ZMP_S = 0.05
"""Half width, s, of the parabola that gives the acceleration of the centre of mass."""


def zero_moment_points(com: FloatArray, dt: float) -> FloatArray:
    """Zero-moment points (T, 2) m on the floor, NaN in free fall and at both ends. com (T, 3) m. dt: s.

    For a point mass p = c - z / (g + z'') c''.
    """
    half = max(round(ZMP_S / dt), 1)
    found = np.full((len(com), 2), np.nan)
    if len(com) <= 2 * half:
        return found
    at = dt * np.arange(-half, half + 1)
    # Rows of the pseudo-inverse give the coefficients of the parabola as weighted sums of the window.
    weights = np.linalg.pinv(np.vander(at, 3))
    windows = np.lib.stride_tricks.sliding_window_view(com, 2 * half + 1, axis=0)  # (T - 2 half, 3, window)
    acceleration, place = 2.0 * windows @ weights[0], windows @ weights[2]
    pull = GRAVITY + acceleration[:, 2:]
    point = place[:, :2] - place[:, 2:] / np.where(pull > 0.0, pull, np.nan) * acceleration[:, :2]
    found[half:-half] = point
    return found


def foot_slide(place: FloatArray, lowest: FloatArray) -> float:
    """Largest distance, m, of a sole from its touchdown. place (T, 3) m of the sole; lowest (T,) m, height of its
    lowest corner."""
    slide = 0.0
    for first, last in spans(np.asarray(lowest <= CONTACT_M)):
        on_ground = place[first:last, :2]
        slide = max(slide, float(np.linalg.norm(on_ground - on_ground[0], axis=1).max()))
    return slide


def spans(flags: BoolArray) -> list[tuple[int, int]]:
    """First row, and the one after the last, of each run of true rows (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]


REACTIVE = 2
"""Mode of an observer in contact; 1: it damps the approach; 0: nothing is near."""


@dataclass(frozen=True)
class ModeSwitches:
    """Changes of mode per second: mean of all observers, and the worst with its name, None if none changed."""

    mean: float
    worst: float
    name: str | None


def observer_activity(modes: NDArray[np.uint8], names: tuple[str, ...], dt: float) -> tuple[ModeSwitches, float] | None:
    """Changes of observer modes (T, n), and the share of ticks with any in contact; None without ticks or observers.
    dt: s."""
    ticks, count = modes.shape
    if count != len(names):
        raise ValueError(f"{len(names)} names for {count} observers")
    if not ticks or not count:
        return None
    changed = modes[1:] != modes[:-1]
    per_second = changed.sum(axis=0) / (max(ticks - 1, 1) * dt)  # (n,) [1/s]
    worst = int(np.argmax(per_second))
    name = names[worst] if per_second[worst] > 0.0 else None
    switches = ModeSwitches(float(per_second.mean()), float(per_second[worst]), name)
    return switches, float((modes == REACTIVE).any(axis=1).mean())


HEAT_MODEL = "stated, calibrated on no hardware"


@dataclass(frozen=True)
class TorqueSpread:
    """Absolute torque of a servo, N m."""

    p95: float
    max: float


@dataclass(frozen=True)
class PhysicsReport:
    """A simulated run. fallen_at_s: on the run's time; how: in words. toppled: fall at rest without torque.
    min_zmp_margin_mm: of the centre of pressure in the loaded soles; None for a walk. foot_slip_mm: of each loaded
    sole, and `total`. torque_nm, temperature_c: per servo. self_contacts, fixture_contacts: ticks with any.
    realtime_factor: clip time over wall time."""

    mount: str
    seed: int
    perturbations: tuple[str, ...]
    fallen: bool
    fallen_at_s: float | None
    how: str | None
    toppled: str | None
    min_zmp_margin_mm: float | None
    foot_slip_mm: dict[str, float]
    sole_tilt_max_deg: float
    torque_nm: dict[str, TorqueSpread]
    temperature_c: dict[str, float]
    heat_model: str
    self_contacts: int
    fixture_contacts: int
    realtime_factor: float | None


def physics_report(run: RunResult) -> PhysicsReport | None:
    """The physics part of the report; None without simulated mass."""
    physics, robot = run.physics, run.robot
    if physics is None or robot is None:
        return None
    # A walking robot loads the edges of its soles.
    walks = run.tally.walk is not None and run.tally.walk.steps > 0
    fall, margin = physics.fall, None if walks else physics.least_margin
    slip = dict(zip(robot.profile.feet, (MM * physics.slip).tolist(), strict=True))
    size = np.abs(physics.torque)
    if len(size):
        spreads = zip(np.percentile(size, 95, axis=0).tolist(), size.max(axis=0).tolist(), strict=True)
        torque = {joint: TorqueSpread(*spread) for joint, spread in zip(robot.joint_map.joints, spreads, strict=True)}
    else:
        torque = {}
    return PhysicsReport(
        mount=physics.mount,
        seed=physics.seed,
        perturbations=physics.perturbations,
        fallen=fall is not None,
        fallen_at_s=None if fall is None else fall.time,
        how=None if fall is None else fall.how,
        toppled=None if physics.toppled is None else physics.toppled.how,
        min_zmp_margin_mm=None if margin is None else MM * margin,
        foot_slip_mm=slip | {"total": MM * float(physics.slip.sum())},
        sole_tilt_max_deg=float(np.degrees(physics.tilt)),
        torque_nm=torque,
        temperature_c=dict(zip(robot.joint_map.joints, physics.hottest.tolist(), strict=True)),
        heat_model=HEAT_MODEL,
        self_contacts=physics.contacts[0],
        fixture_contacts=physics.contacts[1],
        realtime_factor=run.ticks_followed * run.clip.dt / max(run.wall_s, 1e-9) or None,
    )
