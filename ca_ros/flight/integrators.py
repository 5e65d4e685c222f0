"""Integrators: one step of a differential equation."""

from __future__ import annotations

from collections.abc import Callable

from ca_ros.arrays import Array

Derivative = Callable[[Array], Array]


def euler(derivative: Derivative, state: Array, step: float) -> Array:
    """Return the state after an explicit Euler step, of order 1."""
    return state + step * derivative(state)


def rk4(derivative: Derivative, state: Array, step: float) -> Array:
    """Return the state after a step of the classical Runge-Kutta method, of order 4."""
    k1 = derivative(state)
    k2 = derivative(state + 0.5 * step * k1)
    k3 = derivative(state + 0.5 * step * k2)
    k4 = derivative(state + step * k3)
    return state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


INTEGRATORS = {'euler': euler, 'rk4': rk4}  # by the value of `simulator.integrator`
