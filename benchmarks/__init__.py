"""The benchmark: how fast everything is, beside the solvers of others."""
