"""The compiled core: kinematics, strict hierarchies, whole frames.

Conventions are MuJoCo's. `q (nq,)` holds a free joint as world xyz and quaternion wxyz, a ball joint as wxyz, a
hinge in rad, a slide in m. `dq (nv,)` holds a free joint as world linear, then link-local angular motion. Links are
numbered from 0, the world. Arrays are float64 and C-contiguous; bad shapes, NaN and inverted limits raise
ValueError. The GIL is released while solving.
"""

from typing import Literal, TypeAlias, TypeVar, final, overload

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Number = TypeVar("Number", float, Floats)
PlayoutSample: TypeAlias = tuple[Floats, Floats, NDArray[np.bool_], Floats, NDArray[np.int8], Floats]

@final
class Body:
    """A tree of links joined by free (0), ball (1), slide (2) and hinge (3) joints.

    Links are sorted (a parent before its children); joints are sorted by link. `qpos0` holds the values of q at the
    rest geometry.
    """

    def __init__(
        self,
        parent: NDArray[np.int64],
        body_pos: Floats,
        body_quat: Floats,
        mass: Floats,
        com: Floats,
        joint_body: NDArray[np.int64],
        joint_type: NDArray[np.int64],
        joint_axis: Floats,
        joint_pos: Floats,
        qpos0: Floats,
    ) -> None: ...
    @property
    def nq(self) -> int: ...
    @property
    def nv(self) -> int: ...
    @property
    def total_mass(self) -> float: ...
    def rest(self) -> Floats:
        """Posture (nq,) of the rest geometry."""
    def forward(self, q: Floats) -> tuple[Floats, Floats]:
        """World positions (nbody, 3) and orientations (nbody, 4) wxyz of the links."""
    def points(self, q: Floats, links: list[int], local: Floats) -> Floats:
        """World positions (T, k, 3) of points `local (k, 3)` of `links`, for postures q (T, nq)."""
    def orientations(self, q: Floats, links: list[int]) -> Floats:
        """World orientations (T, k, 4) wxyz of `links`, for postures q (T, nq)."""
    def centre_of_mass(self, q: Floats) -> Floats:
        """Centre of mass (T, 3), for postures q (T, nq)."""
    def frame_jacobian(self, q: Floats, link: int, local: tuple[float, float, float]) -> Floats:
        """(6, nv): linear, then angular, world frame, of a point of a link."""
    def centre_of_mass_jacobian(self, q: Floats) -> Floats:
        """(3, nv), world frame."""
    def integrate(self, q: Floats, dq: Floats) -> Floats:
        """q (+) dq."""
    def difference(self, q_from: Floats, q_to: Floats) -> Floats:
        """dq (nv,) with q_from (+) dq = q_to."""

@final
class Probe:
    """Quantities that are read from one posture in each tick: positions of points `local` (k, 3) m of `links`,
    orientations of the j links `oriented`, and the centre of mass."""

    def __init__(self, body: Body, links: list[int], local: Floats, oriented: list[int]) -> None: ...
    def read(self, q: Floats) -> tuple[Floats, Floats, Floats]:
        """Posture q (nq,) -> points (k, 3) m, orientations (j, 4) wxyz, centre of mass (3,) m; world."""

@final
class Footing:
    """Soles with corners `local` (k, 3) m of `links`, planted at `planted` (k, 3) m, world, and the edges (e, 3) of
    their support polygon: nx x + ny y <= d inside, normals of length 1."""

    def __init__(self, body: Body, links: list[int], local: Floats, planted: Floats, edges: Floats) -> None: ...
    def losses(self, path: Floats) -> tuple[float, float]:
        """Largest slip of a corner, and least distance of the centre of mass inside the edges, over postures (T, nq);
        m."""

@final
class Task:
    """A task of a body. It owns a slice of the target vector: a leading weight (0 or NaN: absent this frame), then its
    target.

    `gain` is the share of the error corrected per iteration; `max_error` caps the correction per iteration (m or rad).
    Row weights multiply rows (so the objective holds their squares), and the leading weight too, except in a last level
    with a posture, where the leading weight and the weights of a posture multiply squares directly.
    """

    @staticmethod
    def position(
        body: int,
        point: tuple[float, float, float] = ...,
        *,
        base: tuple[int, tuple[float, float, float]] | None = None,
        weight: tuple[float, float, float] = ...,
        gain: float = 1.0,
        max_error: float = 0.05,
    ) -> Task:
        """A point of a link goes to a world position; with `base`, a link and a point of it, to an offset from that
        point, in world axes. Target 3."""
    @staticmethod
    def orientation(
        body: int,
        quat: tuple[float, float, float, float] = ...,
        *,
        weight: tuple[float, float, float] = ...,
        gain: float = 1.0,
        max_error: float = 0.2,
    ) -> Task:
        """The frame `quat` of a link takes a world orientation. Target 4, wxyz. Rows are world axes."""
    @staticmethod
    def axis(
        body: int, axis: tuple[float, float, float], *, weight: float = 1.0, gain: float = 1.0, max_error: float = 0.2
    ) -> Task:
        """An axis of a link points along a world direction. Target 3. Two rows."""
    @staticmethod
    def centre_of_mass(
        *,
        weight: tuple[float, float, float] = ...,
        over: int | None = None,
        gain: float = 1.0,
        max_error: float = 0.05,
    ) -> Task:
        """The centre of mass goes to a world position, or to an offset from the origin of link `over`. Target 3;
        rows where weight > 0."""
    @staticmethod
    def support(max_edges: int, *, without: list[int] = ..., max_error: float = 0.05) -> Task:
        """The centre of mass stays inside half-spaces: max_edges times (nx, ny, nz, d), nx x + ny y + nz z <= d, as
        over the edges of a support polygon; unused ones are 0, 0, 0, 0. without: coordinates (of nv) that do not take
        part."""
    @staticmethod
    def lever(body: int, point: tuple[float, float, float], max_edges: int, *, max_error: float = 0.05) -> Task:
        """The centre of mass c and a point p of a link stay inside half-spaces of both: max_edges times (nx, ny, nz,
        mx, my, mz, d), n . c + m . p <= d; unused ones are 0. They bound the load of a joint at p, for example."""
    @staticmethod
    def look_at(
        body: int,
        point: tuple[float, float, float],
        axis: tuple[float, float, float],
        *,
        weight: float = 1.0,
        gain: float = 1.0,
        max_error: float = 0.2,
    ) -> Task:
        """An axis of a link, from a point of it, aims at a world point. Target 3. Two rows."""
    @staticmethod
    def reactive(
        *,
        of: list[int] | None = None,
        against: Literal["all", "self", "scene"] = "all",
        speed: float = 0.1,
    ) -> Task:
        """Observers (all, or those of these numbers) that touch push their part out at `speed` m/s.

        No target beside the leading weight: on or off."""
    @staticmethod
    def preventive(
        *,
        of: list[int] | None = None,
        against: Literal["all", "self", "scene"] = "all",
        speed: float = 0.5,
    ) -> Task:
        """Observers within influence damp the approach of their part. `speed` (m/s): permitted approach at the
        influence distance, if all act. No target beside the leading weight."""
    @staticmethod
    def posture(weight: Floats, *, gain: float = 1.0, max_error: float = 0.3) -> Task:
        """Every coordinate with a positive weight (nv,) goes to that of a posture. Target nq. `max_error` holds per
        coordinate."""

@final
class Observers:
    """Shapes on the links of a body that look at each other and at obstacles.

    n observers: links (n,), kinds (n,) and sizes (n, 3) as in `shape_distances`, positions (n, 3) m and quats (n, 4)
    wxyz of the shapes' frames on their links, influence and margin (n,) m. pairs (p, 2): observers that look at each
    other, pair_margin (p,) m: most that a pair keeps. k obstacles: obstacle_kinds (k,), obstacle_sizes (k, 3),
    obstacle_influence and obstacle_margin (k,) m. obstacle_pairs (m, 2): an observer and an obstacle that it looks at,
    obstacle_pair_margin (m,) m: most that it keeps; without them every observer looks at every obstacle. A pair has the
    larger influence and the larger margin of its two sides.
    """

    def __init__(
        self,
        body: Body,
        *,
        links: NDArray[np.int64],
        kinds: NDArray[np.int64],
        sizes: Floats,
        positions: Floats,
        quats: Floats,
        influence: Floats,
        margin: Floats,
        pairs: NDArray[np.int64],
        obstacle_kinds: NDArray[np.int64],
        obstacle_sizes: Floats,
        obstacle_influence: Floats,
        obstacle_margin: Floats,
        pair_margin: Floats | None = None,
        obstacle_pairs: NDArray[np.int64] | None = None,
        obstacle_pair_margin: Floats | None = None,
    ) -> None: ...

@final
class PathChecker:
    """Check that a path of postures keeps every pair of `observers` apart, between its rows too.

    Rows of a path (k, n) are values of n hinges and slides, the entries `columns (n,)` of a posture, and straight lines
    between rows. With soles (links, and points (s, 3) m of them) the lower one stays planted and the root follows from
    it; without soles the root stays.
    """

    def __init__(
        self,
        body: Body,
        observers: Observers,
        *,
        columns: NDArray[np.int64],
        sole_links: list[int],
        sole_points: Floats,
    ) -> None: ...
    def set_obstacles(self, position: Floats, quat: Floats, linear: Floats, angular: Floats) -> None:
        """Set the poses of the k obstacles at the first row, and their velocities; see `Solver.set_obstacles`."""
    def restart(self) -> None:
        """Forget which pairs were too near."""
    def is_clear(
        self,
        standing: Floats,
        path: Floats,
        *,
        dt: float,
        share: float,
        instead: Floats | None = None,
        remember: bool = True,
        looks: int = 100,
    ) -> bool:
        """True if every pair keeps a share of its margin on a path (k, n), dt s from row to row, of a robot that stands
        as in `standing (nq,)`.

        A pair that is too near at the first row may only separate. instead (k, n): the path that is followed after a
        refusal; a moving obstacle that is at no row nearer than it came so far on that path does not count. remember:
        the first row is the commanded posture, from which the tolerance of pairs that are too near is measured. looks:
        most postures that are computed; a path that is not proven by then is not clear."""
    @property
    def refused(self) -> tuple[int, int | None, int | None] | None:
        """The pair that last refused a path since `restart`: numbers of an observer, and of another one or of an
        obstacle; None if no path was refused."""

@final
class Solver:
    """A body, its levels and limits, and the state of the convergence loop.

    The box of a frame holds for the whole frame: position, velocity, acceleration and braking distance (see
    `Braking.bounds`). Locked coordinates (nv,) never move. A level is damped (m/rad) by the root of its error (m) times
    the size of the body (m) times `damping`.
    """

    def __init__(
        self,
        body: Body,
        levels: list[list[Task]],
        *,
        lower: Floats,
        upper: Floats,
        max_velocity: Floats,
        max_acceleration: Floats,
        locked: NDArray[np.bool_],
        n_ik: int = 2,
        max_step: float = 0.3,
        damping: float = 0.5,
        early_stop: bool = True,
        observers: Observers | None = None,
        activation: Literal["closest", "all"] = "closest",
    ) -> None: ...
    @property
    def target_size(self) -> int: ...
    def target_slice(self, level: int, task: int) -> tuple[int, int]:
        """(start, stop) of a task in the target vector, its leading weight included."""
    def reset(self, q: Floats, velocity: Floats | None = None) -> None:
        """Start from posture q (nq,), moving at velocity (nv,) per second."""
    def correct(self, q: Floats, velocity: Floats) -> None:
        """Go on from posture q (nq,), near to the one that was reached, moving at velocity (nv,) per second. Unlike
        `reset`, this keeps the bounds of distances of observers."""
    def foresee(self, rest: Floats, seconds: float) -> None:
        """Plan the stop of the next frame: the posture in which the body would rest, and the seconds until then.
        Observers keep their margins there too. Without a plan joints are taken to brake in proportion. rest (k, nq):
        one posture, or more through which only locked coordinates go."""
    def frame(self, targets: Floats, dt: float, speed_override: float = 1.0) -> Floats:
        """One frame of dt seconds: targets (target_size,) -> posture (nq,).

        speed_override: (0, 1], scales the limits of velocity, and by its square those of acceleration; to brake, a
        joint may always use all of its acceleration."""
    def brake(self, dt: float, most: int, *, pendulum: float = 0.0) -> Floats:
        """Postures (k, nq) of a stop, dt seconds each and at most `most`. The velocities of coordinates and of the
        centre of mass fall linearly to zero; points and frames that have a task stay. The slowest coordinate brakes at
        its full deceleration. pendulum: s, sqrt(height of the centre of mass / g) of a body that may tip over, whose
        mass brakes at MASS_BRAKING, or in that time; 0 for another. If k < most, the body may stop at once after the
        last row."""
    def set_obstacles(
        self,
        position: Floats,
        quat: Floats,
        linear: Floats | None = None,
        angular: Floats | None = None,
        present: NDArray[np.bool_] | None = None,
    ) -> None:
        """Set the k obstacles at the start of the next frame: position (k, 3) m and quat (k, 4) wxyz of their shapes'
        frames, linear (k, 3) m/s and angular (k, 3) rad/s velocity, world. They move on at these velocities from frame
        to frame. present (k,): flags; before the first call no obstacle is present."""
    @property
    def observer_modes(self) -> NDArray[np.uint8]:
        """Mode of each observer (n,) in the last frame: 0 free, 1 preventive, 2 reactive."""
    @property
    def clearance(self) -> tuple[float, float]:
        """Smallest distance (m) between observers, and of one to an obstacle, after the last frame; infinite beyond
        influence."""
    @property
    def q(self) -> Floats: ...
    @property
    def velocity(self) -> Floats:
        """Displacement per second of the last frame (nv,)."""
    @property
    def task_errors(self) -> Floats:
        """Error norm of each task at the posture reached, in order of levels; NaN where absent."""
    @property
    def capped(self) -> int:
        """Number of linear solves that were ended after too many steps. Their solutions keep the bounds, and the limits
        that standing still keeps."""

def solve_hierarchy(
    rows: Floats,
    lower: Floats,
    upper: Floats,
    level_sizes: list[int],
    *,
    lo: Floats,
    hi: Floats,
    still: Floats,
    damping: float,
    soft_last: bool = False,
    least_damping: float = 1e-3,
    rounds: int = 1,
    budget: int = 2000,
) -> tuple[Floats, int, bool]:
    """One linear solve: damped least squares of levels, whose rows (m, n) stand one level after the other, with
    lower (m,) <= rows z <= upper (m,) up to a slack, under the hard box lo (n,) <= z <= hi (n,); last, ||z||^2.

    still (n,): the z of no motion, from which damped steps are measured. damping: squared, for each unit of a level's
    error. soft_last: each row of the last level has a variable of its own, and is met beside ||z||^2. least_damping: of
    a level, in units of its rows. rounds: of a level, each from the solution before, which drive its damping to zero.
    budget: most steps.

    Returns z (n,), steps, and true if it was ended early."""

MASS_BRAKING: float
"""Deceleration (m/s^2) with which the centre of mass of a body that stands on its soles can surely be stopped."""

def braking_displacement(gap: float, change: float) -> float:
    """Largest displacement x of a tick for which x + (x - change) + ... down to zero covers no more than `gap`.

    change: most change of a displacement from tick to tick. Beyond the end (gap < 0) the gap itself.
    """

@final
class Braking:
    """Joints that brake in proportion, within limits (n,): their possible displacements in a tick of dt seconds, and
    the path on which they come to rest together. position, goal (n,): present and next; displacement (n,): the last
    one."""

    def __init__(
        self, lower: Floats, upper: Floats, max_velocity: Floats, max_acceleration: Floats, *, dt: float
    ) -> None: ...
    def bounds(self, position: Floats, displacement: Floats) -> tuple[Floats, Floats]:
        """Least and largest displacements (n,) from which joints can brake; to go on braking is always among them."""
    def ticks(self, displacement: Floats) -> float:
        """Ticks of braking until all joints rest, 1 at least: as many as the slowest needs at its full deceleration."""
    def accepted(self, position: Floats, displacement: Floats, goal: Floats, *, tolerance: float) -> Floats | None:
        """Displacement (n,) to a goal that misses no bound by more than `tolerance`, clipped to them; else None."""
    def stop(self, position: Floats, displacement: Floats) -> Floats:
        """Postures (k, n) tick by tick to rest, of joints that got to `position` by `displacement`. They brake in as
        many ticks as the slowest needs; a joint that would leave its range brakes earlier."""
    def keeps(self, position: Floats, displacement: Floats, path: Floats, *, tolerance: float) -> bool:
        """True if joints that got to `position` by `displacement` keep every limit on `path` (k, n), tick by tick, to
        within `tolerance`, and may stop at its end at once."""

@final
class TrajectoryGenerator:
    """Online trajectory generation for slow moves of n joints, called every dt seconds: limits (n,) of velocity in
    rad/s, acceleration in rad/s^2 and jerk in rad/s^3; joints that arrive together; a target that may change in every
    tick.

    Source: a cascade of moving averages (Biagiotti and Melchiorri, "FIR filters for online trajectory planning",
    Control Engineering Practice 20, 2012). A move from rest to rest is a straight line and ends exactly at the target,
    after about distance / v + v / a + 2 a / j. From rest, the position never leaves the convex hull of the start and
    the targets so far. Raises ValueError for NaN, wrong shapes, limits or dt that are not positive, limits that would
    take more than 10,000 ticks to average over, and a use before the first `reset`.
    """

    def __init__(self, max_velocity: Floats, max_acceleration: Floats, max_jerk: Floats, *, dt: float) -> None: ...
    def reset(self, position: Floats, velocity: Floats | None = None, acceleration: Floats | None = None) -> None:
        """Go on from position (n,) rad, velocity (n,) rad/s and acceleration (n,) rad/s^2, absent: at rest; each at
        most 1e6. The acceleration fades out over 2 a / j. A joint that is too fast is braked at its limit of
        acceleration."""
    def step(self, target: Floats, speed_override: float = 1.0) -> Floats:
        """One tick towards rest at target (n,) rad: the new position (n,) rad.

        speed_override: 0 to 1, scales the limits of velocity; 0 brakes to a stop.
        """
    @property
    def position(self) -> Floats: ...
    @property
    def velocity(self) -> Floats:
        """rad/s (n,): the last displacement over dt."""
    @property
    def acceleration(self) -> Floats:
        """rad/s^2 (n,): the last change of velocity over dt."""
    @property
    def at_rest(self) -> bool:
        """True if the joints stand exactly at the target, and stay there."""

@final
class PoseFilter:
    """The One-Euro filter on the poses of `count` sensors; see `retarget.live.playout`.

    position, orientation: (cutoff at rest in Hz, Hz that it rises per m/s or rad/s, cutoff of the speed's own filter in
    Hz), positive; None leaves that part as it is.
    """

    def __init__(
        self,
        count: int,
        *,
        position: tuple[float, float, float] | None,
        orientation: tuple[float, float, float] | None,
    ) -> None: ...
    def step(self, time: Floats, position: Floats, orientation: Floats) -> tuple[Floats, Floats]:
        """Filtered positions (k, 3) and orientations (k, 4) wxyz of poses at times (k,) in s. NaN in, NaN out."""
    def reset(self, rows: NDArray[np.bool_]) -> None:
        """Forget rows (k,): their next pose is taken as it is."""

@final
class PoseRing:
    """The newest `depth` poses of each of `count` sensors, in the order of their times; see `retarget.live.playout`.

    extrapolation: time for which a sensor moves on with its last velocity, s. Results for k sensors: position (k, 3) m
    and orientation (k, 4) wxyz, in the hemisphere of the last result, NaN if none was sent; valid (k,); age (k,) s
    since the newest pose, infinite without one; method (k,): 0 nothing, 1 interpolated, 2 as it was sent, 3
    extrapolated, 4 held; time (k,) s of the result, NaN without one.
    """

    def __init__(self, count: int, *, depth: int, extrapolation: float) -> None: ...
    def push(
        self, rows: NDArray[np.int64], time: float, position: Floats, orientation: Floats, valid: NDArray[np.bool_]
    ) -> tuple[float | None, int, int]:
        """Take poses of m different sensors rows (m,) at one time, s: position (m, 3), orientation (m, 4) of any norm
        and sign, a part NaN where it was not sent; valid (m,): False where the sensor is lost.

        Returns the newest time of those sensors before (minus infinity if there was none, None if no pose is valid),
        and the numbers of poses that were not stored, as repeated and as too old.
        """
    def latest(self, now: float) -> PlayoutSample:
        """The newest pose of every sensor."""
    def read(self, at: float, now: float) -> PlayoutSample:
        """Every sensor at a time `at`, s, not after `now`: between its poses, or a little beyond the newest."""
    def clear(self) -> None:
        """Forget every pose."""

@final
class SensorPlan:
    """Map from frames of `count` poses to m sensors: points (m,) and segments (m,) are the columns of position and
    orientation, -1 for none; turn (m, 4) wxyz is a factor of the orientation; offset (m, 3) m goes from the joint to
    the position that is sent, in the axes of that pose."""

    def __init__(
        self,
        count: int,
        points: NDArray[np.int64],
        segments: NDArray[np.int64],
        turn: Floats,
        offset: Floats,
    ) -> None: ...
    def read(
        self, position: Floats, orientation: Floats, tracked: NDArray[np.bool_]
    ) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Position (m, 3), orientation (m, 4), NaN if there is none, and tracked (m,) from a frame (count, ...)."""

@final
class PoseParts:
    """The last pose of each of `count` sensors, for poses that are sent in parts (position here, rotation
    there)."""

    def __init__(self, count: int) -> None: ...
    def complete(self, rows: NDArray[np.int64], time: float, position: Floats, orientation: Floats) -> None:
        """Replace, in place, missing parts (NaN) of position (m, 3) and orientation (m, 4) of sensors rows (m,) by
        those that were sent at most 0.1 s before `time`."""

@final
class Validity:
    """Validity of the poses of k sensors, and the state of each sensor; see `retarget.human.pose_validation`.

    others (k,): the sensor of the other side of each, -1 where it has none. limits: a `ValidityLimits`, of which the
    fields about poses, speed, age and value are read by their names.
    """

    def __init__(self, others: NDArray[np.int64], limits: object) -> None: ...
    def take(
        self,
        rows: NDArray[np.int64],
        time: float,
        position: Floats,
        orientation: Floats,
        tracked: NDArray[np.bool_],
    ) -> NDArray[np.uint8] | None:
        """Judge poses of one capture, position (m, 3) m, orientation (m, 4) wxyz or NaN throughout, of sensors rows
        (m,), and keep what is valid. Returns a verdict on each (m,), 0 or a key of `REASONS`; None: all are valid."""
    def judge(self, now: float) -> NDArray[np.uint8]:
        """A `ValidityState` of each sensor at `now`, s."""
    def history(self, row: int) -> tuple[float, float, bool]:
        """Time of the last accepted pose of a sensor, s; time for which it has repeated its value, s; true if it was
        accepted at a new place after its last jump."""

def shape_distances(
    kinds_a: NDArray[np.int64],
    sizes_a: Floats,
    pos_a: Floats,
    quat_a: Floats,
    kinds_b: NDArray[np.int64],
    sizes_b: Floats,
    pos_b: Floats,
    quat_b: Floats,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Signed distance (N,) in m of N pairs of solids, nearest world points a and b (N, 3), unit normal (N, 3) from b to
    a: a - b = distance * normal. A negative distance is the depth along the shortest way out.

    Kinds (N,): 0 capsule (size: radius, half length, 0), 1 cylinder (the same), 2 box (half sizes), 3 half-space (all
    of z <= 0; size ignored). Sizes (N, 3) in m, as MuJoCo orders them; a radius or a length may be 0. Positions (N, 3)
    in m, quaternions (N, 4) wxyz, of any length but 0. Two half-spaces have no distance.
    """

def shape_gaps_at_least(
    kinds_a: NDArray[np.int64],
    sizes_a: Floats,
    pos_a: Floats,
    quat_a: Floats,
    kinds_b: NDArray[np.int64],
    sizes_b: Floats,
    pos_b: Floats,
    quat_b: Floats,
) -> Floats:
    """A lower bound (N,) of the signed distance, m, at a fraction of its cost. Arguments are the same."""

# Arithmetic with the same bits on every machine; see `retarget.arithmetic`.

def sin(x: Number) -> Number:
    """Sine of rad, of a number or of every number of an array."""

def cos(x: Number) -> Number:
    """Cosine of rad."""

def arcsin(x: Number) -> Number:
    """rad; NaN beyond -1 and 1."""

def arccos(x: Number) -> Number:
    """rad; NaN beyond -1 and 1."""

def exp(x: Number) -> Number: ...
def expm1(x: Number) -> Number:
    """exp(x) - 1, exact near 0."""

def log(x: Number) -> Number:
    """Natural logarithm."""

@overload
def arctan2(y: float, x: float) -> float: ...
@overload
def arctan2(y: Floats, x: Floats | float) -> Floats: ...
@overload
def arctan2(y: Floats | float, x: Floats) -> Floats:
    """rad, of the direction (x, y); arrays are broadcast."""

@overload
def hypot(x: float, y: float) -> float: ...
@overload
def hypot(x: Floats, y: Floats | float) -> Floats: ...
@overload
def hypot(x: Floats | float, y: Floats) -> Floats:
    """Length of (x, y); arrays are broadcast."""

def dot(a: Floats, b: Floats) -> float:
    """Inner product of two vectors (n,)."""

def norm(v: Floats) -> float:
    """Length of a vector (n,)."""

def norms(v: Floats) -> Floats:
    """Lengths (...) of vectors (..., n)."""

def squares(v: Floats) -> Floats:
    """Squared lengths (...) of vectors (..., n)."""

def matmul(a: Floats, b: Floats) -> Floats:
    """Matrix product of a (..., n) with b (n, m) or (n,): (..., m) or (...)."""

def quat_multiply(a: Floats, b: Floats) -> Floats:
    """Hamilton products (..., 4) wxyz; leading axes are broadcast."""

def quat_rotate(q: Floats, v: Floats) -> Floats:
    """Vectors v (..., 3) turned by unit quaternions q (..., 4) wxyz; leading axes are broadcast."""
