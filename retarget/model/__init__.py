"""Models: robots, the virtual human, scenes, and the shapes of their observers.

In: profiles and body files (MJCF, URDF). Out: frozen data, and bodies for the solver. Imports `schema`.
"""
