"""The links of a robot's parts: proposed from the tree and its names, then corrected by the user."""

import re
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from retarget.errors import ConfigError, Problem, suggest
from retarget.schema.strict_models import Name, Schema, listed, read_model, unknown_name
from retarget.schema.strict_yaml import Document
from retarget.setup.tree import BASE, UP, Tree, flat_underside, words_of
from retarget.types import FloatArray


class PartLinks(Schema):
    """The links of a robot's parts, as of `--links`, null for an absent part. A part that is given only on
    the left has its counterpart on the right."""

    pelvis: Name | None = None
    """Carries the legs."""
    chest: Name | None = None
    """Carries the arms."""
    head: Name | None = None
    """The last link of the neck."""
    l_elbow: Name | None = None
    """The forearm: what the elbow moves."""
    r_elbow: Name | None = None
    """The same of the right arm."""
    l_hand: Name | None = None
    """The last link of the arm; fingers may hang on it."""
    r_hand: Name | None = None
    """The same of the right arm."""
    l_knee: Name | None = None
    """The shin: what the knee moves."""
    r_knee: Name | None = None
    """The same of the right leg."""
    l_sole: Name | None = None
    """The foot, whose underside is the sole."""
    r_sole: Name | None = None
    """The same of the right leg."""


PARTS = tuple(PartLinks.model_fields)
BENDS = {"elbow": "hand", "knee": "sole"}
"""Joint link and end of a limb."""


def read_links(path: Path, tree: Tree) -> PartLinks:
    """Read parts from a file. Raises ConfigError with all of its problems and their lines."""

    def check(links: PartLinks, document: Document) -> list[Problem]:
        return [unknown_name(document, (part,), "link", link, tree.links) for part, link in _unknown(links, tree)]

    return read_model(PartLinks, path, check=check)


def _unknown(given: PartLinks, tree: Tree) -> list[tuple[str, str]]:
    named = given.model_dump(include=given.model_fields_set)
    return [(part, link) for part, link in named.items() if link is not None and link not in tree.links]


def completed(proposed: PartLinks, given: PartLinks, tree: Tree) -> PartLinks:
    """Replace proposed links by given ones. Raises ConfigError for links that cannot be those parts."""
    if unknown := _unknown(given, tree):
        known = listed(tree.links)
        problems = [
            Problem(
                "unknown link", "--links", f"{part}: {link!r}", known, suggest(link, tree.links) or "Name a known one"
            )
            for part, link in unknown
        ]
        raise ConfigError.from_problems(problems)
    parts: dict[str, str | None] = proposed.model_dump() | given.model_dump(include=given.model_fields_set)
    chosen = set(given.model_fields_set)
    for part in given.model_fields_set:
        other = f"r{part[1:]}"
        if part.startswith("l_") and other not in given.model_fields_set:
            parts[other] = _counterpart(parts[part], proposed, part, tree)
            chosen.add(other)
    paths = {part: tree.path(tree.links[link]) for part, link in parts.items() if link is not None}

    def refused(what: str, part: str, other: str) -> Problem:
        found = ", ".join(f"{one}: {parts[one]}" for one in (part, other) if parts.get(one))
        step = f"Name another link, or write {part}: null where it has none; retarget import in a terminal shows them"
        return Problem(what, "--links", found, next_step=step)

    ends = [part for part in paths if part == "head" or part[2:] in BENDS.values()]
    problems = [refused("the base is not the end of a limb", end, "") for end in ends if paths[end] == [BASE]]
    problems += [
        refused("one end of a limb carries the other, or is the same", *sorted(pair, key=lambda one: len(paths[one])))
        for pair in combinations([end for end in ends if paths[end] != [BASE]], 2)
        if paths[pair[0]][-1] in paths[pair[1]] or paths[pair[1]][-1] in paths[pair[0]]
    ]
    for side in "lr" if not problems else "":
        for bend, last in BENDS.items():
            middle, end = f"{side}_{bend}", f"{side}_{last}"
            if middle in paths and end not in paths:
                parts[middle] = None  # nothing is left to bend
            elif middle in paths and paths[middle][-1] not in paths[end][1:] and middle not in chosen:
                parts[middle] = _bend(tree, paths[end], paths.get(f"{'r' if side == 'l' else 'l'}_{last}", []), end)
            elif middle in paths and paths[middle][-1] not in paths[end][1:]:
                problems.append(refused("not between the trunk and the end of the limb", middle, end))
            elif bend == "knee" and parts.get(middle) and parts[middle] == parts[end]:
                problems.append(refused("the shin is not the foot", middle, end))
    if problems:
        raise ConfigError.from_problems(problems)
    return PartLinks.model_validate(parts)


def _bend(tree: Tree, path: list[int], other: list[int], end: str) -> str | None:
    """The elbow or knee of a limb with a given end. path, other: nodes of both limbs from the base."""
    nodes, side = [node for node in path if node not in (BASE, *other)], end[0]
    if not end.endswith("sole"):
        return _arm(tree, nodes, side, NORMALS[0])[f"{side}_elbow"]
    between = tree.nodes[path[-1]].anchor - tree.nodes[other[-1]].anchor if other else NORMALS[0]
    return _leg(tree, nodes, side, max(NORMALS, key=lambda normal: abs(float(between @ normal))))[f"{side}_knee"]


def _counterpart(link: str | None, proposed: PartLinks, part: str, tree: Tree) -> str | None:
    """The right counterpart of a left link: by its name, else by its place on the limb."""
    if link is None:
        return None
    for left, right in (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT"), ("l", "r"), ("L", "R")):
        for match in re.finditer(left, link):
            name = f"{link[: match.start()]}{right}{link[match.end() :]}"
            if name in tree.links:
                return name
    end = getattr(proposed, f"r_{BENDS.get(part[2:], part[2:])}")
    place, path = len(tree.path(tree.links[link])), [] if end is None else tree.path(tree.links[end])
    return tree.nodes[path[place - 1]].names[0] if place <= len(path) else end


# The proposal: limbs are pairs of branches, by names or as mirror images. Names decide first between arms and legs.

TOLERANCE = 0.03
"""Tolerance of mirrored parts, as a share of the robot's size."""
SIDES = {"l": 1, "left": 1, "r": -1, "right": -1}
"""Words of names: 1 for the left, -1 for the right."""
ARM_WORDS = frozenset(words_of("arm sho shoulder upperarm el elbow forearm wrist hand palm gripper finger claw"))
LEG_WORDS = frozenset(words_of("leg hip thigh femur knee shin shank tibia calf ankle ank foot feet sole toe"))
HEAD_WORDS = frozenset(words_of("neck head face"))
NORMALS = (np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))
"""Normals of the plane of symmetry: a robot faces x (REP-103), or y."""
HIPS = 0.6
"""Highest place of hips, as a share of the trunk's height."""
LOW = 0.1
"""Highest place of the ends of feet, as a share of the robot's height."""
FINGERS = 0.3
"""Longest fingers, as a share of a limb's length."""
LEAST_JOINTS = 2
"""Fewest joints of a limb."""
ACROSS = 0.8
"""Least cosine between the left and a pitch axis of a leg."""
LEVER = 0.2
"""Shortest lever of an elbow, as a share of an arm's length."""

Pair = tuple[int, int]
"""First nodes of two limbs, the one farther along the normal first."""


def propose_links(tree: Tree, *, welded: bool = False) -> PartLinks:
    """Propose the links of a robot's parts from names and tree. welded: True if its torso is fixed to the world:
    then limbs of unknown kind are arms."""
    normal, pairs = max(
        ((normal, _pairs(tree, normal)) for normal in NORMALS),
        key=lambda found: sum(len(tree.below(node)) for pair in found[1] for node in pair),
    )
    if not pairs:
        arm = chain(tree, max(tree.children(BASE), key=lambda child: len(tree.below(child))))
        if len(arm) < LEAST_JOINTS:
            return PartLinks()
        return PartLinks.model_validate({"chest": _link(tree, BASE), **_arm(tree, arm, "r", normal)})
    # Above 0 if most names on the limbs are those of an arm, below 0 for a leg.
    kinds = {
        pair: sum((word in ARM_WORDS) - (word in LEG_WORDS) for first in pair for word in _words(tree, first))
        for pair in pairs
    }
    low = [pair for pair in pairs if kinds[pair] < 0 or (not kinds[pair] and not welded and _is_leg(tree, pair, pairs))]
    legs = min(low, key=lambda pair: tree.nodes[pair[0]].anchor[2], default=None)
    rest = [pair for pair in pairs if pair not in low]
    arms = max(rest, key=lambda pair: (kinds[pair] > 0, _span(tree, pair[0])), default=None)
    if _points_left(tree, normal, legs, arms) < 0.0:
        legs, arms = (None if pair is None else pair[::-1] for pair in (legs, arms))
    parts: dict[str, str | None] = {}
    for pair, propose in ((legs, _leg), (arms, _arm)):
        for side, first in zip("lr", pair or (), strict=False):
            parts |= propose(tree, chain(tree, first), side, normal)
    pelvis = BASE if legs is None else tree.nodes[legs[0]].parent
    chest = BASE if arms is None else tree.nodes[arms[0]].parent
    parts |= {"pelvis": _link(tree, pelvis) if legs else None, "chest": _link(tree, chest)}
    return PartLinks.model_validate({**parts, "head": _head(tree, pairs, chest, pelvis, normal)})


def _link(tree: Tree, node: int) -> str | None:
    """The link that a joint moves, or the first link of the base."""
    return next(iter(tree.nodes[node].names), None)


def chain(tree: Tree, first: int) -> list[int]:
    """The nodes of a limb, from the first one outwards, without fingers."""
    nodes, length = [first], 0.0
    while branches := tree.children(nodes[-1]):
        spans = [_span(tree, branch) for branch in branches]
        onward = branches[int(np.argmax(spans))]
        length += float(np.linalg.norm(tree.nodes[onward].anchor - tree.nodes[nodes[-1]].anchor))
        if len(branches) > 1 and max(spans) < FINGERS * (length + max(spans)):
            break
        nodes.append(onward)
    return nodes


def _pairs(tree: Tree, normal: FloatArray) -> list[Pair]:
    """Pairs of limbs: branches whose names differ only by side, or that are mirror images along a normal (3,)."""
    found, waiting = list[Pair](), [BASE]
    while waiting:
        branches = tree.children(waiting.pop())
        tried = []
        for one, other in combinations(branches, 2):
            between = _mark(tree, one) - _mark(tree, other)
            aside = abs(float(between @ normal))
            if aside >= 0.7 * float(np.linalg.norm(between[:2])) > 0.0:
                off = _off_mirror(tree, normal, one, other)
                (side, words), (other_side, other_words) = side_of(tree, one), side_of(tree, other)
                are_named = side * other_side == -1 and words == other_words
                if are_named or off <= TOLERANCE * tree.size:
                    tried.append((off, (one, other) if between @ normal > 0.0 else (other, one)))
        for _, pair in sorted(tried):
            if all(node in branches for node in pair) and min(len(chain(tree, node)) for node in pair) >= LEAST_JOINTS:
                found.append(pair)
                branches = [node for node in branches if node not in pair]
        waiting += branches
    return found


def _off_mirror(tree: Tree, normal: FloatArray, one: int, other: int) -> float:
    """Largest distance, m, between a part of one branch and the mirror image of the other."""
    first, second = (np.array([tree.nodes[node].middle for node in tree.below(branch)]) for branch in (one, other))
    if len(first) != len(second):
        return np.inf
    offset = 0.5 * float((first.mean(axis=0) + second.mean(axis=0)) @ normal)
    image = first - 2.0 * ((first @ normal) - offset)[:, None] * normal
    distances = np.linalg.norm(image[:, None] - second, axis=2)
    return float(max(distances.min(axis=0).max(), distances.min(axis=1).max()))


def _mark(tree: Tree, node: int) -> FloatArray:
    return np.asarray(np.mean([tree.nodes[n].middle for n in tree.below(node)], axis=0))


def side_of(tree: Tree, node: int) -> tuple[int, list[str]]:
    """The side of a node by its names, 1 left, -1 right, 0 neither, and the other words of the name."""
    for name in (tree.nodes[node].joint, *tree.nodes[node].names[:1]):
        words = words_of(name)
        side = next((SIDES[word] for word in words if word in SIDES), 0)
        if side:
            return side, [word for word in words if word not in SIDES]
    return 0, []


def _words(tree: Tree, branch: int) -> list[str]:
    nodes = [tree.nodes[node] for node in tree.below(branch)]
    return [word for node in nodes for name in (node.joint, *node.names) for word in words_of(name)]


def _is_leg(tree: Tree, pair: Pair, pairs: list[Pair]) -> bool:
    """True if a pair ends at the bottom of the robot and begins low on its trunk. Hanging arms begin high."""
    limbs = {node for one in pairs for first in one for node in tree.below(first)}
    heights, trunk = (
        tree.points([node for node in range(len(tree.nodes)) if node not in out])[:, 2] for out in (set[int](), limbs)
    )
    root = float(tree.nodes[pair[0]].anchor[2])
    end = float(tree.points(tree.below(pair[0]))[:, 2].min())
    low = float(heights.min()) + LOW * float(np.ptp(heights))
    return end <= low < root + 1e-9 and root <= float(trunk.min()) + HIPS * float(np.ptp(trunk)) + 1e-9


def _span(tree: Tree, branch: int) -> float:
    """Largest distance of a point of a branch from its first axis, m."""
    return float(np.linalg.norm(tree.points(tree.below(branch)) - tree.nodes[branch].anchor, axis=1).max())


def _points_left(tree: Tree, normal: FloatArray, legs: Pair | None, arms: Pair | None) -> float:
    """A number above 0 if the normal points to the left: by names, by feet that are longer ahead of the ankle,
    and by hands ahead of the shoulders."""
    ahead, total = np.cross(normal, UP), 0.0
    for pair in (legs, arms):
        if pair is not None:
            total += 3.0 * np.sign(side_of(tree, pair[0])[0] - side_of(tree, pair[1])[0])
    if legs is not None:
        leg = chain(tree, legs[0])
        sole, pitches = flat_underside(tree, tree.below(leg[-1])), pitch_joints(tree, leg, normal)
        if sole is not None and pitches:
            along = sole.points @ ahead
            middle = 0.5 * (along.min() + along.max()) - tree.nodes[pitches[-1]].anchor @ ahead
            total += 2.0 * np.sign(middle) * (abs(middle) > 0.02 * np.ptp(along))
    if arms is not None:
        hand = tree.points(tree.below(chain(tree, arms[0])[-1])).mean(axis=0)
        reach = float((hand - tree.nodes[arms[0]].anchor) @ ahead)
        total += np.sign(reach) * (abs(reach) > 0.2 * _span(tree, arms[0]))
    return float(total) or float(ahead @ np.array([1.0, 1.0, 0.0]))


def pitch_joints(tree: Tree, nodes: Sequence[int], left: FloatArray) -> list[int]:
    """The nodes of a leg whose axes lie across the robot, from the hip down. left (3,): or its opposite."""
    return [node for node in nodes if abs(tree.nodes[node].axis @ left) > ACROSS]


def _leg(tree: Tree, nodes: list[int], side: str, normal: FloatArray) -> dict[str, str | None]:
    """The foot, and the knee: the pitch joint that is farthest from both ends of the leg."""
    pitches, floor = pitch_joints(tree, nodes, normal), float(tree.points(tree.below(nodes[-1]))[:, 2].min())
    heights = {node: float(tree.nodes[node].anchor[2]) for node in pitches}
    top = max((heights[node] for node in pitches), default=0.0)
    middles = [node for node in pitches[1:] if node != nodes[-1]]
    knee = max(middles, key=lambda node: min(top - heights[node], heights[node] - floor), default=None)
    return {f"{side}_sole": _link(tree, nodes[-1]), f"{side}_knee": None if knee is None else _link(tree, knee)}


def _arm(tree: Tree, nodes: list[int], side: str, normal: FloatArray) -> dict[str, str | None]:
    """The hand, and the elbow: the joint nearest to the middle of the arm that moves the hand."""
    hand, start = tree.points(tree.below(nodes[-1])).mean(axis=0), tree.nodes[nodes[0]].anchor
    places = np.array([*(tree.nodes[node].anchor for node in nodes), hand])
    least = LEVER * float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    outer = {node: tree.nodes[node].distance(hand) for node in nodes[1:]}
    inner = {node: tree.nodes[node].distance(start) for node, far in outer.items() if far > least}
    elbow = max(inner, key=lambda node: min(inner[node], outer[node]), default=None)
    has_elbow = elbow is not None and inner[elbow] >= least
    return {f"{side}_hand": _link(tree, nodes[-1]), f"{side}_elbow": _link(tree, elbow) if has_elbow else None}  # type: ignore[arg-type]


def _head(tree: Tree, pairs: list[Pair], chest: int, pelvis: int, normal: FloatArray) -> str | None:
    """The last link of the branch that is named for a head, else that reaches highest in the middle."""
    limbs = {first for pair in pairs for first in pair}
    trunk = {*tree.path(chest), *tree.path(pelvis)}
    branches = [n for n, node in enumerate(tree.nodes) if node.parent in trunk and n not in trunk and n not in limbs]
    named = [node for node in branches if not HEAD_WORDS.isdisjoint(_words(tree, node))]
    middle = 0.5 * sum(float(_mark(tree, node) @ normal) for node in pairs[0])
    aside = {node: abs(float(_mark(tree, node) @ normal) - middle) for node in branches}
    height = {node: float(tree.points(tree.below(node))[:, 2].max()) for node in branches}
    above = [node for node in branches if height[node] > tree.nodes[chest].points[:, 2].mean()]
    above = named or [node for node in above if aside[node] <= TOLERANCE * tree.size]
    if not above:
        return None
    node = max(above, key=lambda node: height[node])
    while len(onward := tree.children(node)) == 1:
        node = onward[0]
    return _link(tree, node)
