"""Zonotopes: facets, volume, margins, rays and samples."""

from math import comb

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from ca_ros.solver.zonotope import Zonotope

HEXAGON = Zonotope(np.array([1.0, 2.0]), np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]]))


def some_zonotope(rng, m, n):
    return Zonotope(rng.normal(size=m), rng.normal(size=(m, n)))


def corners(zonotope):
    """Return the images (2^n, m) of the corners of the box."""
    n = zonotope.generators.shape[1]
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * n)).reshape(n, -1)
    return zonotope.center + signs.T @ zonotope.generators.T


def test_hexagon():
    # Three segments of the plane make three pairs of edges, orthogonal to (1, 0), (0, 1), (1, -1).
    # Its area is 4 (|det(1, 2)| + |det(1, 3)| + |det(2, 3)|) = 4 * 3.
    normals, offsets = HEXAGON.facets
    assert len(normals) == len(offsets) == 6
    assert HEXAGON.volume == pytest.approx(12.0)
    # Along x the hexagon is 2 on either side of 1; along (1, -1) / sqrt 2 it is 2 / sqrt 2.
    assert HEXAGON.margin(np.array([1.0, 2.0])) == pytest.approx(np.sqrt(2.0))
    assert HEXAGON.margin(np.array([3.0, 4.0])) == pytest.approx(0.0, abs=1e-15)
    assert HEXAGON.margin(np.array([3.5, 4.0])) == pytest.approx(-0.5)


@pytest.mark.parametrize(('m', 'n'), [(2, 5), (3, 4), (3, 7), (4, 4), (4, 6), (4, 8)])
def test_in_general_position_it_agrees_with_the_convex_hull(m, n):
    zonotope = some_zonotope(np.random.default_rng(n), m, n)
    hull = ConvexHull(corners(zonotope))
    equations = np.unique(np.round(hull.equations, 7), axis=0)
    normals, offsets = zonotope.facets
    # Two facets for each choice of m - 1 generators.
    assert len(normals) == len(equations) == 2 * comb(n, m - 1)
    ours = np.column_stack([normals, -offsets])
    distances = np.abs(ours[:, None] - equations[None]).max(axis=-1)
    assert distances.min(axis=0).max() < 1e-6
    assert distances.min(axis=1).max() < 1e-6
    assert zonotope.volume == pytest.approx(hull.volume, rel=1e-9)


@pytest.mark.parametrize(('m', 'n'), [(1, 3), (2, 5), (3, 7), (4, 8), (6, 9)])
def test_tiles_fill_it_without_overlap(m, n):
    rng = np.random.default_rng(m)
    zonotope = some_zonotope(rng, m, n)
    tiles, centers, volumes = zonotope.tiles
    points = zonotope.center + rng.uniform(-1.0, 1.0, (200, n)) @ zonotope.generators.T
    shares = np.linalg.solve(tiles[None], (points[:, None] - centers[None])[..., None])[..., 0]
    assert np.all(np.sum(np.all(np.abs(shares) <= 1.0, axis=-1), axis=1) == 1)
    np.testing.assert_allclose(volumes, 2.0**m * np.abs(np.linalg.det(tiles)))


def test_parallel_generators_make_one_longer():
    generators = np.array([[1.0, 0.0, 0.5, -2.0], [0.0, 1.0, 0.0, 0.0]])
    zonotope = Zonotope(np.zeros(2), generators)
    assert len(zonotope.facets[0]) == 4
    assert zonotope.volume == pytest.approx(7.0 * 2.0)
    assert zonotope.margin(np.array([3.0, 0.0])) == pytest.approx(0.5)


def test_a_generator_of_length_zero_does_nothing():
    generators = HEXAGON.generators
    zonotope = Zonotope(HEXAGON.center, np.insert(generators, 1, 0.0, axis=1))
    assert zonotope.volume == pytest.approx(12.0)
    assert len(zonotope.facets[0]) == 6


@pytest.mark.parametrize('generators', [
    [[1.0, 2.0, 3.0], [2.0, 4.0, 6.0]], [[1.0, 2.0], [0.0, 0.0]], [[1.0], [1.0]]])
def test_without_volume_it_is_refused(generators):
    with pytest.raises(ValueError, match='span'):
        Zonotope(np.zeros(2), np.array(generators))


def test_rows_may_differ_in_scale():
    rng = np.random.default_rng(0)
    scale = np.array([1e3, 1.0, 1e-4])
    generators = rng.normal(size=(3, 6))
    plain = Zonotope(np.zeros(3), generators)
    flat = Zonotope(np.zeros(3), scale[:, None] * generators)
    assert flat.volume == pytest.approx(scale.prod() * plain.volume)
    points = 4.0 * rng.normal(size=(200, 3))
    inside = plain.margin(points) > 0.0
    assert 20 < inside.sum() < 180
    np.testing.assert_array_equal(flat.margin(scale * points) > 0.0, inside)


def test_so_many_generators_that_facets_would_fill_the_memory_are_refused():
    with pytest.raises(ValueError, match=r'200 rotors and 4 axes .* 1313400 choices'):
        some_zonotope(np.random.default_rng(0), 4, 200)
