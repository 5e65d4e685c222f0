"""Solvers that know no vehicle: quadratic and linear programs with bounds, zonotopes."""
