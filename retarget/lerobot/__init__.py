"""The two devices of LeRobot without LeRobot: a robot that follows actions, and a performer who gives them."""
