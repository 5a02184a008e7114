"""A robot with mass, friction and weak servos, in MuJoCo, behind the same bus as the real one."""
