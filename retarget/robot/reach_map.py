"""Reachability map: places that a hand of a robot on its soles reaches by its arm, with its trunk, and by a crouch.

Places are relative to the middle of the soles, x forward, m. The robot's hierarchy measures the map without rates: a
hand goes to nodes of a grid, outward from those that it reached, with the trunk in its stance (the arm), and with a
free trunk at some heights of the pelvis. The field is the distance to the edge of the reached region, m, negative
inside.
"""

import zipfile
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from retarget.arithmetic import norms
from retarget.errors import InputError, UsageError
from retarget.ik.hierarchy import Hierarchy
from retarget.ik.support_polygon import Stance
from retarget.ik.tasks import SlotKind
from retarget.model.robot import HEAD, TRUNK, RobotBody
from retarget.robot.balance import StandingBalance, StandingStrength
from retarget.robot.crouch_envelope import LEAST_CROUCH_M, Envelope
from retarget.robot.landmarks import PELVIS, DesiredLandmarks, RobotReader, limb_names, standing_targets
from retarget.rotations import Vector
from retarget.schema.arrays import open_arrays
from retarget.schema.catalogue import cache_folder
from retarget.schema.files import make_folder, write_stream
from retarget.schema.priorities import PositionTask, Priorities
from retarget.types import BoolArray, FloatArray, ShowProgress, no_progress

HANDS = ("l_hand", "r_hand")
"""Landmarks of the map."""
NODES = 4
"""Nodes per length of an arm."""
HEIGHTS = 5
"""Number of heights of the pelvis."""
CLOSE_M, KEPT = 0.004, 0.002
"""Errors up to which a place is reached, and higher levels are kept, m and rad."""
REACH: Mapping[str, Any] = {"iterations": 6, "damping": 0.5}
"""Parameters of the solver."""
FRAMES, PROGRESS_M = 8, 0.001
"""Greatest number of frames for a place, and least progress of one, m."""
WAYPOINTS = (0.25, 0.5, 0.75)
"""Shares of the path to a place that are targets first."""
AMID = 4
"""Reached neighbours of a missed node that is tried again."""
FREED = 0.1
"""Relative weight of a free trunk."""
FORMAT = b"reach 4"
"""To be changed when maps in caches become invalid."""
MOST_BYTES = 1 << 26
FAR_M = 1.0
"""Distance if nothing is reached."""

Node = tuple[int, int, int]


class FreeTrunk:
    """Weights between hands by the lines of arms, and hands with places in the world and a free trunk."""

    def __init__(self, priorities: Priorities, hierarchy: Hierarchy) -> None:
        self._hierarchy = hierarchy
        of_pelvis = [task for _, _, task in priorities.tasks() if isinstance(task, PositionTask) and PELVIS in task.of]
        _, slots = hierarchy.position_slots([PELVIS])
        self._heights = [int(slot[0]) for task, slot in zip(of_pelvis, slots, strict=True) if is_height(task)]

    def weigh(self, targets: FloatArray, share: float) -> None:
        """Free the trunk by a share, 0 to 1, in a target vector that is otherwise complete."""
        for name in HANDS:
            self._hierarchy.weigh(targets, SlotKind.LIMB, name, 1.0 - share)
            self._hierarchy.weigh(targets, SlotKind.POSITION, name, share)
        for slot in self._heights:
            targets[slot] = share
        if share > 0.0:
            for kind in (SlotKind.LIMB, SlotKind.ORIENTATION):
                self._hierarchy.weigh(targets, kind, TRUNK, 1.0 + share * (FREED - 1.0))


def is_height(task: PositionTask) -> bool:
    """True for a task on a height alone."""
    return isinstance(task.weight, tuple) and task.weight[:2] == (0.0, 0.0)


class HandReach:
    """The map of one hand, m. low (3,): first node; field (x, y, z, 1 + h + 3): distances to the edges of the arm's
    reach and of that at h heights, and the line to the nearest place in reach."""

    def __init__(self, low: FloatArray, spacing: float, field: FloatArray) -> None:
        self.low, self.spacing, self.field = low, spacing, field
        sizes = field.shape[:3]
        strides = np.array([sizes[1] * sizes[2], sizes[2], 1])
        self._corners = (np.array(list(product((0, 1), repeat=3))) * strides).sum(axis=1)
        self._ends = (low + spacing * (np.array(sizes) - 1)).tolist()
        self._axes = list(zip(low.tolist(), strides.tolist(), [size - 2 for size in sizes], strict=True))
        self._flat = np.ascontiguousarray(field.reshape(-1, field.shape[3]))

    def inside(self, place: Sequence[float]) -> Vector:
        """Nearest place, m, that the grid covers."""
        x, y, z = (min(max(v, axis[0]), end) for v, axis, end in zip(place, self._axes, self._ends, strict=True))
        return x, y, z

    def at(self, place: Vector) -> list[float]:
        """Field at a place inside, m, interpolated in its cell."""
        start, shares = 0, list[tuple[float, float]]()
        for v, (low, stride, last) in zip(place, self._axes, strict=True):
            along = (v - low) / self.spacing
            node = min(int(along), last)
            start += stride * node
            shares.append((1.0 - along + node, along - node))
        (a, b), (c, d), (e, f) = shares
        weights = np.array([a * c * e, a * c * f, a * d * e, a * d * f, b * c * e, b * c * f, b * d * e, b * d * f])
        found: list[float] = (weights[:, None] * self._flat[self._corners + start]).sum(axis=0).tolist()
        return found

    @property
    def nodes(self) -> FloatArray:
        """Places (x, y, z, 3) of the nodes, m."""
        return np.asarray(self.low + self.spacing * np.moveaxis(np.indices(self.field.shape[:3]), 0, -1))


@dataclass(frozen=True, eq=False)
class ReachMap:
    """hands: in the order of HANDS. heights: of the pelvis, m, rising."""

    hands: tuple[HandReach, ...]
    heights: tuple[float, ...]


class ReachProbe:
    """Measures the map of one robot on its soles."""

    def __init__(
        self,
        robot: RobotBody,
        priorities: Priorities,
        stance: Stance,
        hierarchy: Hierarchy,
        standing: DesiredLandmarks,
        balance: StandingBalance,
        strength: StandingStrength | None,
        envelope: Envelope,
    ) -> None:
        """hierarchy: without rates, for REACH. standing: landmarks of the stance."""
        self._hierarchy, self._stance, self._balance, self._strength = hierarchy, stance, balance, strength
        self._free = FreeTrunk(priorities, hierarchy)
        self._reader, marks = RobotReader(robot, stance), robot.profile.landmarks
        self._rows = {name: list(marks).index(name) for name in (*HANDS, PELVIS)}
        self._shoulders = {name: stance.points[marks[name].anchor[0]] for name in HANDS}
        self.spacing = marks[HANDS[0]].robot_length / NODES
        self._pelvis = standing.landmarks[self._rows[PELVIS]]
        highest = max(self._pelvis[2], envelope.lowest + LEAST_CROUCH_M)
        self.heights = tuple(np.linspace(envelope.lowest, highest, HEIGHTS).tolist())
        first = next(index for index, slot in enumerate(hierarchy.slots) if slot.name in HANDS)
        watched = (SlotKind.PREVENTIVE, SlotKind.PREVIOUS)
        self._kept = [index for index, slot in enumerate(hierarchy.slots[:first]) if slot.kind not in watched]
        self._standing = targets = standing_targets(hierarchy, stance)
        soles = {sole.frame.name for sole in stance.soles}
        for name, place in zip(marks, standing.landmarks, strict=True):
            if name not in soles:
                hierarchy.set_position(targets, name, np.array(place))
        for name, line in zip(limb_names(robot.profile), standing.limbs, strict=True):
            _, slots = hierarchy.position_slots([name], SlotKind.LIMB)
            targets[slots] = (1.0, *line)
        hierarchy.set_orientation(targets, TRUNK, np.array(self._reader.trunk_at_stance))
        hierarchy.set_look_at(targets, HEAD, 1e3 * np.array(standing.gaze))

    def measure(self, progress: ShowProgress = no_progress) -> ReachMap:
        """Measure the map, in seconds to a minute."""
        hands = []
        with progress("reachability map", len(HANDS) * (1 + HEIGHTS)) as done:
            for number, hand in enumerate(HANDS):
                layers = []
                for layer, height in enumerate((None, *self.heights)):
                    layers.append(self._flood(hand, height))
                    done(number * (1 + HEIGHTS) + layer + 1)
                hands.append(_hand_reach(layers, self.spacing))
        return ReachMap(tuple(hands), self.heights)

    def _flood(self, hand: str, height: float | None) -> "_Layer":
        """Reach of a hand with the pelvis at a height, m; None: by the arm in the stance."""
        layer, row = _Layer({}, []), self._rows[hand]
        targets, by_place = self._standing.copy(), float(height is not None)
        if height is not None:
            self._hierarchy.set_position(targets, PELVIS, np.array([*self._pelvis[:2], height]))
        self._free.weigh(targets, by_place)
        start, at = self._go(targets, self._stance.q, row, None)
        _, slots = self._hierarchy.position_slots([hand], SlotKind.POSITION if by_place else SlotKind.LIMB)
        begin = np.zeros(3) if by_place else self._shoulders[hand]
        ends: dict[Node, FloatArray] = {}

        def reach(node: Node, q: FloatArray, shares: Sequence[float]) -> None:
            """Try a node from posture q (nq,), by shares of the path."""
            place = self.spacing * np.array(node)
            for share in (*shares, 1.0):
                targets[slots] = (1.0, *(at + share * (place - at) - begin).tolist())
                q = self._frame(targets, q) if share < 1.0 else q
            end, there = self._go(targets, q, row, place, height)
            layer.reached[node] = bool(norms(there - place) < CLOSE_M)
            if layer.reached[node]:
                ends[node] = end
            if np.isfinite(there).all():
                layer.places.append(there)

        first = np.floor(at / self.spacing).astype(int)
        corners = {(x, y, max(z, 0)) for x, y, z in (first + np.indices((2, 2, 2)).reshape(3, -1).T).tolist()}
        queue = deque(sorted(corners, key=lambda node: float(norms(self.spacing * np.array(node) - at))))
        while queue:
            node = queue.popleft()
            if node not in layer.reached:
                reach(node, start, WAYPOINTS)
                queue.extend(_neighbours(node) if layer.reached[node] else ())
        # A missed node is tried again from the postures of its neighbours.
        for node in [node for node, there in layer.reached.items() if not there]:
            near = [ends[one] for one in _neighbours(node) if one in ends]
            for q in near if len(near) >= AMID else ():
                if not layer.reached[node]:
                    reach(node, q, ())
        return layer

    def _go(
        self, targets: FloatArray, q: FloatArray, row: int, place: FloatArray | None, height: float | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Final posture (nq,) on the path to a place, m, and place (3,) m of a landmark; NaN if higher levels are
        missed."""
        solver, last = self._hierarchy.solver, np.inf
        for _ in range(FRAMES):
            q = self._frame(targets, q)
            now = self._reader.read(q)
            missed = 1.0 if place is None else float(norms(now.points[row] - place))
            if missed < CLOSE_M or abs(last - missed) < PROGRESS_M < abs(1.0 - missed):
                break
            last = missed
        kept = np.nanmax(solver.task_errors[self._kept]) < KEPT
        if height is not None and place is not None:
            kept &= abs(now.points[self._rows[PELVIS], 2] - height) < CLOSE_M
        return q, now.points[row] if kept else np.full(3, np.nan)

    def _frame(self, targets: FloatArray, q: FloatArray) -> FloatArray:
        at = self._reader.read(q).centre_of_mass
        self._hierarchy.set_support(targets, self._balance.spaces(at, np.zeros(3), 1.0))
        if self._strength is not None:
            self._strength.aim(self._hierarchy, targets, q, at, 1.0)
        self._hierarchy.solver.reset(q)
        return self._hierarchy.solver.frame(targets, 1.0)


@dataclass(frozen=True, eq=False)
class _Layer:
    """Nodes with True if reached; places (3,) m at which the hand ended."""

    reached: dict[Node, bool]
    places: list[FloatArray]


def _neighbours(node: Node) -> list[Node]:
    x, y, z = node
    near = [(x - 1, y, z), (x + 1, y, z), (x, y - 1, z), (x, y + 1, z), (x, y, z - 1), (x, y, z + 1)]
    return [one for one in near if one[2] >= 0]


def _hand_reach(layers: Sequence[_Layer], spacing: float) -> HandReach:
    tried = np.array(sorted({node for layer in layers for node in layer.reached}))
    low, size = tried.min(axis=0), tried.max(axis=0) - tried.min(axis=0) + 1
    nodes = (low + np.moveaxis(np.indices(size), 0, -1)).reshape(-1, 3)
    index = {node: row for row, node in enumerate(map(tuple, nodes.tolist()))}
    field = np.zeros((len(nodes), len(layers) + 3))
    masks = []
    for column, layer in enumerate(layers):
        was_tried, reached = np.zeros((2, len(nodes)), dtype=np.bool_)
        for node, there in layer.reached.items():
            was_tried[index[node]], reached[index[node]] = True, there
        masks.append(reached)
        field[:, column], _ = _distances(spacing * nodes, reached, was_tried & ~reached, layer.places, spacing)
    anywhere, places = np.any(masks[1:], axis=0), [place for layer in layers[1:] for place in layer.places]
    _, field[:, -3:] = _distances(spacing * nodes, anywhere, ~anywhere, places, spacing)
    return HandReach(spacing * low, spacing, np.round(field, 5).reshape(*size, -1))


def _distances(
    nodes: FloatArray, reached: BoolArray, missed: BoolArray, places: Sequence[FloatArray], spacing: float
) -> tuple[FloatArray, FloatArray]:
    """Distances (n,) of nodes (n, 3) to the edge, and lines (n, 3) to the nearest place of a hand, m."""
    distance, line = np.full(len(nodes), FAR_M), np.zeros((len(nodes), 3))
    if places:
        ends = np.array(places)
        for row in np.flatnonzero(~reached).tolist():
            gaps = ends - nodes[row]
            length = norms(gaps)
            nearest = int(length.argmin())
            distance[row], line[row] = length[nearest], gaps[nearest]
    # The edge is outside a ball about a missed node.
    balls, radii = nodes[missed], distance[missed]
    for row in np.flatnonzero(reached).tolist():
        depth = (norms(balls - nodes[row]) - radii).min() if len(balls) else np.inf
        distance[row] = -min(max(float(depth), 0.0), 2.0 * spacing)
    return distance, line


def map_path(robot: RobotBody, priorities: Priorities) -> Path:
    """Place of a robot's map in the cache."""
    digest = sha256(
        FORMAT + f" {NODES} {HEIGHTS} ".encode() + robot.content + priorities.model_dump_json().encode()
    ).hexdigest()
    return cache_folder() / "reach" / f"{robot.profile.name}-{digest[:24]}.npz"


def save_map(found: ReachMap, path: Path) -> None:
    """Write a map. Raises UsageError with the system's reason."""
    arrays = {"heights": np.array(found.heights)}
    for name, hand in zip(HANDS, found.hands, strict=True):
        arrays |= {f"{name}_low": hand.low, f"{name}_spacing": np.array(hand.spacing), f"{name}_field": hand.field}
    make_folder(path.parent, option="cache")
    write_stream(path, lambda stream: np.savez_compressed(stream, allow_pickle=False, **arrays), option="cache")


def load_map(path: Path) -> ReachMap | None:
    """Read a map; None if it is missing or damaged."""
    with suppress(InputError, KeyError, zipfile.BadZipFile):
        read = open_arrays(path, lambda names: names, max_bytes=MOST_BYTES, advice="Delete it")
        heights = read.floats("heights", HEIGHTS)
        hands = tuple(
            HandReach(
                read.floats(f"{name}_low", 3),
                float(read.floats(f"{name}_spacing")),
                read.floats(f"{name}_field", None, None, None, 1 + HEIGHTS + 3),
            )
            for name in HANDS
        )
        if all(min(hand.field.shape[:3]) >= 2 and hand.spacing > 0.0 for hand in hands):
            return ReachMap(hands, tuple(heights.tolist()))
    return None


def reach_map(robot: RobotBody, priorities: Priorities, probe: Callable[[], ReachProbe]) -> ReachMap:
    """Map of a robot, from the cache or measured by a probe and kept there."""
    path = map_path(robot, priorities)
    found = load_map(path)
    if found is None:
        found = probe().measure()
        with suppress(UsageError):
            save_map(found, path)
    return found
