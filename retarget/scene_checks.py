"""Cross checks of a scene's obstacles: distances, lengths, keys that go together, times that rise."""

import math
from collections.abc import Iterable, Mapping
from itertools import pairwise

from retarget.errors import Problem
from retarget.scalar_rotations import inverse, minus, product, rotation_vector
from retarget.scene_parts import MAX_SPEED, MAX_TURN, Obstacle, PathPoint
from retarget.scene_poses import unit
from retarget.strict_yaml import Document, KeyPath

__all__ = ["check_obstacles"]

MIN_LENGTH = 1e-6
"""Shortest segment, capsule or cylinder that has a direction, m."""
SAME_POINT = 1e-6
"""Positions (m) and orientations (rad) closer than this are the same: where a loop closes."""


def check_obstacles(obstacles: Mapping[str, Obstacle], document: Document) -> list[Problem]:
    """All problems of the obstacles that are sound by themselves."""
    problems = []
    if document.data.get("obstacles") == {}:
        problems.append(document.problem(("obstacles",), "a scene without obstacles", allowed="one obstacle at least"))
    for name, obstacle in obstacles.items():
        for check in (_distances, _length, _motion, _path):
            problems += check(obstacle, document, ("obstacles", name))
    return problems


def _distances(obstacle: Obstacle, document: Document, here: KeyPath) -> Iterable[Problem]:
    if obstacle.influence > obstacle.margin:
        return
    key = "influence" if "influence" in obstacle.model_fields_set else "margin"
    yield document.problem(
        (*here, key),
        "the influence must be larger than the margin",
        found=f"influence {obstacle.influence} m, margin {obstacle.margin} m",
        allowed=f"influence above {obstacle.margin} m",
        next_step="Observers yield from the influence on, down to the margin",
    )


def _length(obstacle: Obstacle, document: Document, here: KeyPath) -> Iterable[Problem]:
    shape = obstacle.shape
    for label in ("segment", "capsule", "cylinder"):
        line = getattr(shape, label)
        if line is not None and math.dist(line.start, line.end) < MIN_LENGTH:
            yield document.problem(
                (*here, "shape", label, "to"),
                f"a {label} without length",
                found=f"{list(line.end)}, where it begins",
                allowed="two different points",
                next_step="" if label == "segment" else "A ball is a sphere",
            )


def _motion(obstacle: Obstacle, document: Document, here: KeyPath) -> Iterable[Problem]:
    given = {type(obstacle).model_fields[key].alias or key for key in obstacle.model_fields_set}
    if obstacle.path is not None:
        for key in ("at", "velocity", "angular_velocity", "from", "until"):
            if key in given:
                step = f"Remove {key!r} or 'path'"
                yield document.problem((*here, key), f"'path' and {key!r} exclude each other", next_step=step)
        return
    if obstacle.loop:
        yield document.problem((*here, "loop"), "a loop without a path", next_step="Add 'path', or remove 'loop'")
    if obstacle.velocity is None and obstacle.angular_velocity is None:
        for key in ("from", "until"):
            if key in given:
                step = f"Add 'velocity', or remove {key!r}"
                yield document.problem((*here, key), "a time without a velocity", next_step=step)
    elif obstacle.until is not None and obstacle.until <= obstacle.start:
        found, allowed = f"{obstacle.until} s", f"later than 'from', {obstacle.start} s"
        yield document.problem((*here, "until"), "the motion ends before it begins", found=found, allowed=allowed)


def _path(obstacle: Obstacle, document: Document, here: KeyPath) -> Iterable[Problem]:
    path = obstacle.path
    if path is None:
        return
    here = (*here, "path")
    if len(path) < 2:
        step = "An obstacle that stays has 'at' instead"
        yield document.problem(here, "a path of fewer than two points", found=str(len(path)), next_step=step)
        return
    for index, (before, after) in enumerate(pairwise(path), 1):
        place = (*here, index, "time")
        if after.time <= before.time:
            yield document.problem(
                place,
                "a moving obstacle whose times do not rise",
                found=f"{after.time} s after {before.time} s",
                allowed=f"more than {before.time} s",
            )
        else:
            yield from _speeds(before, after, document, place)
    if obstacle.loop and max(_apart(path[0], path[-1])) > SAME_POINT:
        yield document.problem(
            (*here, len(path) - 1),
            "the loop does not close",
            found=f"pos {list(path[-1].pos)}, quat {list(path[-1].quat)}",
            allowed=f"the first pose: pos {list(path[0].pos)}, quat {list(path[0].quat)}",
        )


def _speeds(before: PathPoint, after: PathPoint, document: Document, place: KeyPath) -> Iterable[Problem]:
    step = after.time - before.time
    way, turn = _apart(before, after)
    for value, limit, unit_name in ((way / step, MAX_SPEED, "m/s"), (turn / step, MAX_TURN, "rad/s")):
        if value > limit:
            what, found = "the path is too fast", f"{value:.4g} {unit_name} since the point before"
            yield document.problem(place, what, found=found, allowed=f"at most {limit:g} {unit_name}")


def _apart(a: PathPoint, b: PathPoint) -> tuple[float, float]:
    """Distance, m, and angle, rad, between two poses."""
    turn = rotation_vector(product(unit(b.quat), inverse(unit(a.quat))))
    return math.hypot(*minus(b.pos, a.pos)), math.hypot(*turn)
