"""A robot with mass, friction and weak servos in MuJoCo, behind the bus of the real one."""
