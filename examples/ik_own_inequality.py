"""Inverse kinematics alone, with an inequality: the hand of a URDF arm stays in front of a wall that comes nearer."""

from retarget import ik

URDF = """<robot name="arm"><link name="base"/>{links}</robot>"""
LINK = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name} link"/>
  <origin xyz="{x} 0 0"/><axis xyz="0 0 1"/><limit lower="-2.5" upper="2.5" effort="1" velocity="2"/></joint>
  <link name="{name} link"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>
  <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def main() -> None:
    """Move the wall through the place where the hand is sent, and print who gives way."""
    joints = ("shoulder", "elbow", "wrist")
    chain = zip(joints, ("base", "shoulder link", "elbow link"), (0.0, 0.2, 0.2), strict=True)
    links = [LINK.format(name=name, parent=parent, x=x) for name, parent, x in chain]
    body = ik.load_body_text(URDF.format(links="".join(links)), source="an arm in a plane")
    hand = ik.Position("wrist link", point=(0.2, 0.0, 0.0), weight=(1.0, 1.0, 0.0))
    wall = ik.HalfSpaces("wrist link", point=(0.2, 0.0, 0.0), most=1)  # n . p <= d
    solver = ik.Solver(body, [[wall], [hand], [ik.Posture()]], start=[-0.7, 1.0, 0.6])
    for tick in range(200):
        at = 0.6 - 0.001 * tick
        solver.solve({wall: [(1.0, 0.0, 0.0, at)], hand: (0.5, 0.1, 0.0)}, 0.01)
    print(f"wall at {at:.3f} m, hand at {solver.position('wrist link', point=(0.2, 0.0, 0.0))[0]:.3f} m")
    print(f"hand: {1000 * solver.error(hand):.1f} mm off, the wall: {1000 * solver.error(wall):.1f} mm off")


if __name__ == "__main__":
    main()
