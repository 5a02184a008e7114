"""One run of a robot.

In: options, a performer's samples, servo states. Out: checked goals and their record. May import `robot`, `safety`,
`live` and all below them.
"""
