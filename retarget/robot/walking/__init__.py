"""Walking: a robot on its own soles steps as it is asked to go, while arms and head follow the performer.

In: a velocity that is asked (`travel`), the posture of the standing robot. Out: postures of legs and root, tick by
tick, on a path that always ends standing (`walker`), and goals that hold servos in them (`walking_goals`). It may
import what `retarget.robot` may."""
