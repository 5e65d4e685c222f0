"""Tables and figures: the studies, the benchmark, the report."""
