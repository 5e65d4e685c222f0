"""How fast everything is, beside solvers that others have written."""
