"""Solvers independent of vehicles: quadratic and linear programs with bounds, zonotopes."""
