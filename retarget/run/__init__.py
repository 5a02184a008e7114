"""One run of a robot. In: options, a performer's samples, servo states. Out: checked goals and their record. Imports
all of `robot`, `safety` and `live`."""
