"""The second stage: the robot's posture that follows the virtual human."""
