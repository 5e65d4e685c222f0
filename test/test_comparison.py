"""The allocators that only the studies have: peers outside the set, direct about hover."""

import numpy as np
import pytest

from ca_ros import AdmissibleSet, Status, make_allocator
from ca_ros.studies.comparison import DirectAboutHover, HierarchicalDaqp
from ca_ros.studies.wrench_sets import samples
from strategies import HEXAROTOR

SET = AdmissibleSet(HEXAROTOR)


def test_hierarchical_daqp_answers_every_wrench():
    pytest.importorskip('daqp')
    daqp, exact = HierarchicalDaqp(HEXAROTOR), make_allocator('exact', HEXAROTOR)
    inside, outside = (samples(SET, kind, 0, 0, 300) for kind in ('volume', 'outside'))
    ours, theirs = exact.allocate_batch(inside), daqp.allocate_batch(inside)
    # What it leaves of attainable wrenches, which it takes for soft constraints.
    assert np.abs(theirs.residual).max() < 5e-6
    np.testing.assert_allclose(theirs.thrusts, ours.thrusts, atol=1e-4)
    ours, theirs = exact.allocate_batch(outside), daqp.allocate_batch(outside)
    assert (theirs.violation < 1e-7).all()
    # Of roll and pitch, its first level, no method misses less in the 2-norm.
    missed = [np.linalg.norm(each.residual[:, 1:3], axis=1) for each in (theirs, ours)]
    assert (missed[0] <= missed[1] + 1e-5).all()
    same = (np.abs(theirs.wrench - ours.wrench) < 1e-5).all(axis=1)
    assert 0.4 < same.mean() < 0.6


def test_direct_about_hover_keeps_the_direction_of_the_change_from_hover():
    direct = DirectAboutHover(HEXAROTOR)
    inside, outside = (samples(SET, kind, 1, 0, 100) for kind in ('volume', 'outside'))
    assert np.abs(direct.allocate_batch(inside).residual).max() < 1e-12
    batch, hover = direct.allocate_batch(outside), SET.problem.hover
    assert Status.REJECTED not in list(batch.status)
    served = SET.scale(outside, scale_reference=hover)
    np.testing.assert_allclose(batch.wrench, served, atol=1e-9)
