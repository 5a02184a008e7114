"""Side by side with peers: frame times on one body, same targets, tasks and limits, every side's errors beside."""
