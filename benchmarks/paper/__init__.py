"""The paper's experiments and figures, run anew: `python -m benchmarks.paper`, or `make paper`."""
