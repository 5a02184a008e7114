"""Golden runs: the same runs by two versions of this project, compared to the bit."""
