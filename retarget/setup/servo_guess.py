"""Drafts of servos: models, limits and speeds."""

import math
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hardware.dynamixel.codec import MAX_ID
from hardware.dynamixel.control_table import find_table
from hardware.servo import SERVO_MODELS, Layout, ServoModel, find_model
from retarget.errors import InputError
from retarget.schema.profile_parts import Gains, Servo
from retarget.setup.body_draft import BodyDraft
from retarget.setup.frames import Anatomy
from retarget.setup.tree import Tree

SPARE_SPEED = 0.9
"""Share of the no-load speed, so that some torque is left."""
SPARE_TORQUE = 0.5
"""Share of the stall torque that accelerates. The rest is for gravity."""
ACCELERATIONS = (8.0, 40.0)
"""Least and greatest acceleration, rad/s^2."""
IN_LEGS = 30.0
"""Greatest acceleration in legs and trunk, rad/s^2, since they carry more than hangs on them."""
SAME_MODEL = 1.35
"""Largest ratio of torques that identifies a model."""
UNKNOWN = "XM430-W350"
NO_TORQUE = "the body states no torque"
PLACEHOLDER_NM = 1000.0
"""Torque from which on it is a placeholder, N m: joints of humanoids of human size have up to 400."""
STRONGER = "no known model has"
"""First words of `ServoDraft.why` if the joint needs a stronger servo."""
LOW_VOLTAGE = 6.0
"""Servos for less (5 V) do not share a line with the others, V."""
SHORTEST = 4
"""Fewest letters by which a model is recognised in a longer name."""
END_TICKS = 4
"""Distance of limits from the ends of the servo's travel, ticks."""


@dataclass(frozen=True)
class ServoDraft:
    """A drafted servo. why: reason of the model. note: change of the joint. numbered: True if the id is the number in
    its name."""

    joint: str
    entry: Servo
    why: str
    note: str = ""
    numbered: bool = False


def models_in_names(names: Iterable[str]) -> list[ServoModel]:
    """The servo models in names of meshes and links, the most frequent one first. A series (xl330) stands for
    its first model."""
    plain = [re.sub("[^a-z0-9]", "", name.lower()) for name in names]
    for length in (None, 1):  # XL330-M288, then XL330, but not MX
        known = {"".join(name.lower().split("-")[:length]): name for name in reversed(SERVO_MODELS)}
        known = {plain: name for plain, name in known.items() if len(plain) >= SHORTEST}
        found = Counter(known[max(held, key=len)] for name in plain if (held := [one for one in known if one in name]))
        if found:
            return [SERVO_MODELS[name] for name, _ in found.most_common()]
    return []


def guess_servos(body: BodyDraft, tree: Tree, anatomy: Anatomy, *, model: str = "") -> tuple[ServoDraft, ...]:
    """Draft a servo for each hinge. Ids are the numbers in the names of the joints, else places in the body.
    model: of all servos; "" to choose by the names of meshes and links, else by torque and speed. Raises HardwareError
    for an unknown model, InputError for limits that no servo reaches."""
    torques, speeds = _torques(body.model), body.speeds
    stated = [torque for torque in torques.values() if torque > 0.0]
    named = [find_model(model)] if model else models_in_names([*body.hints, *tree.links])
    candidates = named
    if not named:  # models of protocol 2 and one layout, with the supply of the one nearest to the strongest joint
        known = [entry for entry in SERVO_MODELS.values() if 2 in entry.protocols and entry.layout is Layout.X]
        nearest = _chosen(known, max(stated, default=0.0), 0.0)[0]
        candidates = [one for one in known if (one.voltage < LOW_VOLTAGE) == (nearest.voltage < LOW_VOLTAGE)]
    inertias = _inertias(body.model)
    carrying = {node for leg in anatomy.legs.values() for node in leg.nodes}
    carrying |= {*tree.path(anatomy.chest), *tree.path(anatomy.pelvis)}
    drafts, ids = [], _numbers(node.joint for node in tree.nodes[1:])
    for number, node in enumerate(tree.nodes[1:], 1):
        torque = torques.get(node.joint, 0.0)
        chosen, why = candidates[0], "as given" if model else "by the names in the file"
        if (len(named) > 1 and torque > 0.0) or not named:
            chosen, why = _chosen(candidates, torque, speeds.get(node.joint, 0.0))
        limits, note = _limits(node.joint, node.lower, node.upper, chosen)
        note = "; ".join(filter(None, (body.limits.get(node.joint, ""), note)))
        speed = math.floor(10.0 * SPARE_SPEED * chosen.no_load_speed) / 10.0
        most = IN_LEGS if number in carrying else ACCELERATIONS[1]
        can = SPARE_TORQUE * chosen.stall_torque / max(inertias[node.joint], 1e-6)
        gain = find_table(chosen.name, max(chosen.protocols)).p_gain
        gains = {} if gain is None else {"p": gain.initial}
        entry = Servo(
            id=ids[number - 1] if ids else number,
            model=chosen.name,
            bus="main",
            direction=1,
            zero_tick=chosen.centre_tick,
            limits=limits,
            max_velocity=min(speed, speeds.get(node.joint, math.inf)),
            max_acceleration=float(math.floor(min(max(can, ACCELERATIONS[0]), most))),
            gains=Gains(**gains),  # the maker's default
        )
        drafts.append(ServoDraft(node.joint, entry, why, note, numbered=bool(ids)))
    return tuple(drafts)


def _numbers(names: Iterable[str]) -> list[int]:
    """The last, or first, number in each joint's name; [] unless they are distinct ids of servos."""
    found = [re.findall("[0-9]+", name) for name in names]
    for place in (-1, 0):
        numbers = [int(one[place]) for one in found if one]
        if len(set(numbers)) == len(found) and all(1 <= one <= MAX_ID for one in numbers):
            return numbers
    return []


def _chosen(candidates: list[ServoModel], torque: float, speed: float) -> tuple[ServoModel, str]:
    """The model whose stall torque, N m, and speed, rad/s, if stated, are nearest by ratio, and the reason."""
    if torque <= 0.0:
        return SERVO_MODELS[UNKNOWN], NO_TORQUE

    def off(entry: ServoModel) -> float:
        fast = abs(math.log(speed / entry.no_load_speed)) if 0.5 < speed < 20.0 else 0.0
        return abs(math.log(torque / entry.stall_torque)) + 0.5 * fast

    best = min(candidates, key=off)
    if abs(math.log(torque / best.stall_torque)) > math.log(SAME_MODEL):
        strength = f"{torque:.3g} N m, the nearest {best.stall_torque:g}"
        return best, f"{STRONGER if torque > best.stall_torque else 'no model is as weak as'} {strength}"
    return best, f"by its {torque:.3g} N m"


def _torques(model: Any) -> dict[str, float]:
    """The torque, N m, that the file states for each joint, without placeholders."""
    import mujoco

    torques = {}
    for joint in range(model.njnt):
        if model.jnt_actfrclimited[joint]:
            torques[model.joint(joint).name] = float(np.abs(model.jnt_actfrcrange[joint]).max())
    for index in range(model.nu):
        if model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_JOINT and model.actuator_forcelimited[index]:
            name = model.joint(int(model.actuator_trnid[index, 0])).name
            force = float(np.abs(model.actuator_forcerange[index]).max())
            torques[name] = force * abs(float(model.actuator_gear[index, 0]))
    return {name: torque for name, torque in torques.items() if torque < PLACEHOLDER_NM}


def _inertias(model: Any) -> dict[str, float]:
    """Inertia about each hinge in the zero pose, kg m^2: the diagonal of the joint-space inertia matrix."""
    import mujoco

    data, matrix = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, matrix)
    return {model.joint(joint).name: float(matrix[dof, dof]) for joint, dof in enumerate(model.jnt_dofadr)}


def _limits(joint: str, lower: float, upper: float, model: ServoModel) -> tuple[tuple[float, float], str]:
    """Clip the joint's range, rad, to the servo's travel, with 0 at its middle. Also returns a note."""
    half = 0.5 * model.travel - END_TICKS * model.tick_rad
    low, high = max(lower, -half), min(upper, half)
    if not (math.isfinite(lower) and math.isfinite(upper)):
        return (_down(low), _up(high)), "the body sets no limits"
    if low >= high:
        raise InputError(
            "a joint that its servo cannot turn as far as its limits",
            found=f"{joint}: {lower:.4g} to {upper:.4g} rad",
            allowed=f"some of -{half:.4g} to {half:.4g} rad, half of the servo's turn to either side of 0",
            next_step="Turn the zero of the joint in the body file (<origin>, or ref) so that its limits are around 0",
        )
    changed = (low, high) != (lower, upper)
    return (_down(low), _up(high)), "drawn into the servo's turn" if changed else ""


def _down(value: float) -> float:
    """Round a lower limit inwards to 1e-6 rad."""
    return math.ceil(value * 1e6 - 1e-3) / 1e6


def _up(value: float) -> float:
    return math.floor(value * 1e6 + 1e-3) / 1e6
