"""Tables and plots: the studies, the benchmark, the report."""
