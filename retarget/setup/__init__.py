"""Setting up: a robot profile drafted from a body file, fitted observers, servo zeros, and the doctor.

`source` reads an MJCF or URDF and refuses what cannot be used, `tree` and `mirror` find what moves and what is left and
right of it, `limbs` which of that are legs, arms and head, `frames_found` the points on them, `sole_shape` the soles,
`servo_guess` the servos, `postures_found` how it stands; `draft_text` writes it all as a profile with comments, and
`import_robot` does one after the other.
"""
