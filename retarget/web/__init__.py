"""The pages of a run: live for `web://` and `--view`, and of a recording. In: ticks and poses from browsers; out: pages
to browsers, frames of poses and operator requests to the run. May import `pictures` and all below it."""
