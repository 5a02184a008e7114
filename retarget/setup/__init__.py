"""Setting up a robot and a machine. In: body files, servos of an open bus, live streams. Out: a drafted profile
(`import_robot`), observers (`fit_observers`), servo zeros (`homing`), the stiffness of servos, and findings of the
doctor. May import `web` and all below it."""
