"""The bodies of the benchmark: a model, the points tracked on it, its limits and the posture it is drawn to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from retarget.model.body import BodyModel, load_body
from retarget.model.human import build_human
from retarget.model.human_dimensions import HumanDimensions, proportional_dimensions

Floats = NDArray[np.float64]
OP3 = Path(__file__).resolve().parent.parent / "configs" / "robots" / "op3" / "body.xml"
HUMAN_SPEED = 4.0  # rad/s
OP3_SPEED = 4.5  # rad/s, just under an unloaded XM430-W350 at 12 V


@dataclass(frozen=True)
class Point:
    """A tracked point: `at` (3,) m in the frame of a link."""

    name: str
    link: str
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class BenchBody:
    """A body under test. `attractor` (nq,): where posture tasks pull; `swing`: angles (rad) added at the peak."""

    name: str
    mjcf: str
    model: BodyModel
    locked: NDArray[np.bool_]
    points: tuple[Point, ...]
    max_speed: float
    attractor: Floats
    swing: dict[str, float]

    @property
    def degrees_of_freedom(self) -> int:
        """Coordinates that move."""
        return int(np.count_nonzero(~self.locked))

    @property
    def locked_joints(self) -> list[str]:
        """Names of the joints that stay at zero."""
        return [name for name, locked in zip(self.model.dof_names, self.locked, strict=True) if locked]

    def links(self) -> list[int]:
        """Index of the link of every point."""
        return [self.model.body_index(point.link) for point in self.points]

    def offsets(self) -> Floats:
        """Place of every point on its link (k, 3) m."""
        return np.array([point.at for point in self.points])

    def reduced_model(self) -> Any:
        """MuJoCo model without the locked joints, and with a site at every point, for peers."""
        return self.reduced_spec().compile()

    def reduced_spec(self) -> Any:
        """What that model is compiled from."""
        spec = mujoco.MjSpec.from_string(self.mjcf)
        for name in self.locked_joints:
            spec.delete(spec.joint(name))
        for point in self.points:
            spec.body(point.link).add_site(name=f"bench_{point.name}", pos=list(point.at))
        return spec


def bench_human(dimensions: HumanDimensions | None = None) -> BenchBody:
    """The virtual human, 51 DoF, of average size by default."""
    human = build_human(dimensions or proportional_dimensions(1.75))
    both = {"hip_flexion": 45.0, "knee_flexion": 80.0, "shoulder_elevation": 45.0, "elbow_flexion": 60.0}
    swing = {f"{side}_{name}": np.deg2rad(value) for side in "lr" for name, value in both.items()}
    head = human.body.frame("head")
    head_link = human.body.body_names[head.body]
    return BenchBody(
        name="human",
        mjcf=human.mjcf,
        model=human.body,
        locked=human.locked,
        points=(
            Point("l_ankle", "l_ankle"),
            Point("r_ankle", "r_ankle"),
            Point("l_wrist", "l_wrist"),
            Point("r_wrist", "r_wrist"),
            Point("head", head_link, (float(head.position[0]), float(head.position[1]), float(head.position[2]))),
        ),
        max_speed=HUMAN_SPEED,
        attractor=human.posture("attractor"),
        swing={**swing, "spine_flexion": np.deg2rad(15.0), "neck_rotation": np.deg2rad(20.0)},
    )


def bench_op3() -> BenchBody:
    """ROBOTIS OP3, 20 joints and a free root."""
    model = load_body(OP3)
    knee, arm = 0.6, 0.5
    # Mirrored joints have mirrored axes: + on the left is - on the right.
    left = {"l_hip_pitch": -knee / 2, "l_knee": knee, "l_ank_pitch": knee / 2, "l_sho_pitch": arm, "l_sho_roll": arm}
    pose = {**left, "l_el": -arm}
    pose |= {name.replace("l_", "r_", 1): -value for name, value in pose.items()}
    address = {name: int(model.joint_qpos[model.joint_index(name)]) for name in pose}
    attractor = model.qpos0.copy()
    for name, value in pose.items():
        attractor[address[name]] = value
    return BenchBody(
        name="op3",
        mjcf=OP3.read_text(encoding="utf-8"),
        model=model,
        locked=np.zeros(model.nv, dtype=bool),
        points=(
            Point("l_ankle", "l_ank_roll_link"),
            Point("r_ankle", "r_ank_roll_link"),
            Point("l_wrist", "l_el_link", (0.0, 0.15, 0.0)),
            Point("r_wrist", "r_el_link", (0.0, -0.15, 0.0)),
            Point("head", "head_tilt_link", (0.01425, -0.019, 0.04975)),
        ),
        max_speed=OP3_SPEED,
        attractor=attractor,
        swing=pose | {"head_pan": 0.4},
    )
