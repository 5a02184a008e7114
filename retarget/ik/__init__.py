"""From priorities to a solver's hierarchy: tasks, support polygon, gravity torque, the whole-body stop."""
