"""The last checks of a run.

In: goals with their stops, servo states. Out: checked goals, contacts, falls. May import `ik` and all below it.
"""
