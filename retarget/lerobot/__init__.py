"""The devices of LeRobot without LeRobot: a robot that follows actions, and a performer who gives them. Actions and
observations are dictionaries of joint angles, rad. It may import `run` and what is below."""
