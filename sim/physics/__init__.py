"""A robot with mass, friction and weak servos in MuJoCo, behind the bus interface of the real one."""
