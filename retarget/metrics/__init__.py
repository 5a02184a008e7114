"""What a run says about itself: `measure.measure` makes the report of a run; the other files hold the maths."""
