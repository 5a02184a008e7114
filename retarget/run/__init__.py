"""A run: options, preparation, the loop of its ticks, trajectories in joint space, and its result."""
