"""Inverse kinematics alone: two arms are sent to each other's side, and keep clear of each other and of the table."""

import numpy as np

from retarget import ik


def arm(name: str, y: float) -> str:
    """An arm of two links beside the other one, m."""
    return f"""<body name="{name} upper arm" pos="0 {y} 0.3">
      <joint name="{name} turn" axis="0 0 1" range="-170 170"/><joint name="{name} lift" axis="0 1 0" range="-100 100"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
      <body name="{name} forearm" pos="0.3 0 0"><joint name="{name} elbow" axis="0 1 0" range="-150 150"/>
        <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.03"/><site name="{name} hand" pos="0.25 0 0"/></body>
    </body>"""


def main() -> None:
    """Cross them for three seconds, and print what they came to."""
    table = '<geom name="table" type="box" size="0.6 0.6 0.02"/>'
    text = f"<mujoco><worldbody>{table}{arm('left', 0.2)}{arm('right', -0.2)}</worldbody></mujoco>"
    left, right, clear = ik.Position("left hand"), ik.Position("right hand"), ik.KeepClear(margin=0.02)
    body = ik.load_body_text(text, source="two arms")
    solver = ik.Solver(body, [[clear], [left], [right], [ik.Posture()]], start=[0.0, -0.5, 1.0] * 2, max_velocity=2.0)
    nearest = np.inf
    for _ in range(300):
        solver.solve({left: (0.4, -0.15, 0.3), right: (0.4, 0.15, 0.3)}, 0.01)
        nearest = min(nearest, solver.clearance)
    print(f"left hand, which comes first: {1000 * solver.error(left):.1f} mm off")
    print(f"right hand: {1000 * solver.error(right):.1f} mm off")
    print(f"they were never nearer than {1000 * nearest:.1f} mm")


if __name__ == "__main__":
    main()
