"""Published experiments, run again: one module an experiment, each a benchmark, a figure and the paper's claims."""
