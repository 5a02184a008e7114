"""Pictures, animations and the HTML page of a finished run, and the output files of a command. In: a run and its
report. Out: PNG, WebP, GIF, MP4 and HTML. May import `report` and all below it."""
