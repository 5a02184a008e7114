"""Small bodies that several tests read."""

TWO_LINK_URDF = """<robot name="two">
<link name="base"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><!-- arm -->
<link name="tip"/>
<joint name="swing" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.5" rpy="0.1 0 0"/>
  <axis xyz="0 1 0"/><limit lower="-1" upper="2" velocity="1" effort="1"/></joint>
<joint name="weld_tip" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="0 0 1"/></joint>
</robot>"""

ALL_JOINTS_MJCF = """<mujoco><compiler angle="radian"/><worldbody>
<body name="base" pos="0 0 1" euler="0.2 0.1 0"><freejoint name="root"/><geom size="0.1" mass="3" pos="0.02 0 0"/>
  <site name="tool" pos="0 0.1 0" euler="0 0 1"/>
  <body name="upper" pos="0.1 0.2 0.3" quat="0.9 0.1 0.3 0.2">
    <joint name="twist" axis="1 2 0" pos="0.05 0 0" range="-1 2" ref="0.3"/>
    <joint name="rail" type="slide" axis="0 1 1" range="-0.1 0.2"/><geom size="0.1" mass="2"/>
    <body name="lower" pos="0 0 -0.4">
      <joint name="ball" type="ball" pos="0 0 0.1" range="0 1"/><geom size="0.05" mass="1" pos="0 0 -0.1"/>
      <body name="hand" pos="0 0 -0.3" euler="0 1 0"><geom size="0.05" mass="0.5"/></body></body></body>
  <body name="other" pos="0 -0.2 0"><joint axis="0 0 1"/><geom size="0.05" mass="0.5" pos="0 0 -0.1"/></body></body>
</worldbody></mujoco>"""
"""Every kind of joint, two on one link, off-centre anchors, a reference angle, a fixed link, an unnamed joint."""
