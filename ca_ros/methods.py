"""The allocation methods: the one list that parameters, nodes, studies and tests follow."""

from __future__ import annotations

METHODS = {
    'exact': 'ca_ros.allocation.exact:Exact',
    'pseudo_inverse': 'ca_ros.allocation.pseudo_inverse:PseudoInverse',
    'conventional': 'ca_ros.allocation.conventional:Conventional',
    'direct': 'ca_ros.allocation.direct:Direct',
}
"""Module and class by name, in the order of the paper's Table 1.

By words, for the check of a parameter must not import what is checked.
"""
