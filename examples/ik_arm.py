"""Inverse kinematics alone: an arm from MJCF text draws a circle with its hand, as fast as its joints may."""

import numpy as np

from retarget import ik

ARM = """<mujoco><worldbody><body name="upper arm">
  <joint name="turn" axis="0 0 1" range="-170 170"/><joint name="lift" axis="0 1 0" range="-100 100"/>
  <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
  <body name="forearm" pos="0.3 0 0"><joint name="elbow" axis="0 1 0" range="0 150"/>
    <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.025"/><site name="hand" pos="0.25 0 0"/></body>
</body></worldbody></mujoco>"""


def main() -> None:
    """Draw it once in four seconds, and print how far off the hand was."""
    hand = ik.Position("hand")
    body = ik.load_body_text(ARM, source="the arm")
    start = [0.0, -0.8, 1.4]
    solver = ik.Solver(body, [[hand], [ik.Posture()]], start=start, max_velocity=2.0, max_acceleration=20.0)
    centre, off = solver.position("hand") - [0.0, 0.0, 0.1], []
    for time in np.arange(0.0, 4.0, 0.01):
        angle = 0.5 * np.pi * time
        q = solver.solve({hand: centre + 0.1 * np.array([0.0, np.sin(angle), np.cos(angle)])}, 0.01)
        off.append(solver.error(hand))
    print(f"hand: {1000 * np.mean(off):.2f} mm off on average; it ends with the joints at {np.round(q, 2)} rad")


if __name__ == "__main__":
    main()
