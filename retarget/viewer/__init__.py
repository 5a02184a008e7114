"""What people look at: a web page with performer, robot, goals and servos, of a recorded run or of one that runs."""
