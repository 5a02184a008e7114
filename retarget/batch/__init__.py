"""Retargeting of data sets, clip by clip. In: motion files and options of a run. Out: a motion file for each clip, an
index with a row for each clip, and a table. May import `setup` and all below it."""
