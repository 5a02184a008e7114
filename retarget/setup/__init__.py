"""Setting up: a robot profile drafted from a body file, fitted observers, servo zeros, and the doctor.

Importing a robot: `robot_file` reads an MJCF or URDF and refuses what cannot be used; `body_draft` makes the body of
the profile. `tree` finds the joints, their mirror images and the soles; `limbs` finds legs, arms and head; `frames` the
named points on them; `servo_guess` the servos; `postures` how the robot stands. `draft` writes all of it as a profile
with comments, and `import_robot` runs these steps.

Observers: `shape_fit`, `survey`, and `fit_observers`, which runs them. Servo zeros: `homing`. The doctor:
`doctor_machine`, `doctor_sensors` and `doctor_stream`.
"""
