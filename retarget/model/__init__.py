"""Bodies: MJCF and URDF files as trees of links, the robot, the virtual human, observers and obstacles."""
