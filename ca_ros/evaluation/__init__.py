"""Tables and plots: the studies and the benchmark."""
