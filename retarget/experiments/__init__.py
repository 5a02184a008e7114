"""The paper's experiments and figures, run anew: `retarget experiments`."""
