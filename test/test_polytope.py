"""Vertices, sections and projections of admissible sets, against SciPy's hulls."""

from itertools import product

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection

from ca_ros import AdmissibleSet, AllocationProblem, Vehicle
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.vehicle.files import shipped_vehicles
from strategies import length

SHIPPED = length(['hexarotor_tilted', 'x8'], sorted(shipped_vehicles()))


def random_set(seed):
    """Return the set of a random matrix, often with generators that are parallel or in a plane."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(2, 5))
    n = int(rng.integers(m, 10))
    matrix = (rng.integers(-2, 3, (m, n)).astype(float) if seed % 2
              else rng.normal(size=(m, n)) * 10.0 ** rng.uniform(-2, 2, (m, 1)))
    problem = AllocationProblem(matrix, rng.uniform(-2.0, 0.0, n), rng.uniform(0.0, 2.0, n))
    return AdmissibleSet(problem) if problem.interior.has_volume else None, rng


RANDOM = [seed for seed in range(length(7, 130)) if random_set(seed)[0] is not None]

SETS = [*SHIPPED, *RANDOM]


def set_of(case):
    if isinstance(case, str):
        return AdmissibleSet(VehicleProblem(Vehicle.load(case))), np.random.default_rng(1)
    return random_set(case)


def hull(points):
    """Return SciPy's hull of points, whose axes have one size, and the factor of its volume."""
    size = np.ptp(points, axis=0)
    return ConvexHull(points / size), size.prod()


def axes_of(image, rng, k):
    names = image.problem.axes
    return [names[i] for i in rng.choice(len(names), min(k, len(names)), replace=False)]


@pytest.mark.parametrize('case', SETS)
def test_the_vertices_are_those_of_the_hull_and_span_the_volume(case):
    image, _ = set_of(case)
    found, factor = hull(image.vertices)
    assert found.volume * factor == pytest.approx(image.volume, rel=1e-9)
    assert len(found.vertices) == len(image.vertices)
    # Each vertex comes from effectors at their bounds.
    assert np.abs(image.margin(image.vertices)).max() <= 1e-9 * np.abs(image.vertices).max()


@pytest.mark.parametrize('k', [1, 2, 3])
@pytest.mark.parametrize('case', SETS)
def test_a_projection_is_the_hull_of_projected_vertices(case, k):
    image, rng = set_of(case)
    axes = axes_of(image, rng, k)
    shadow = image.projection(axes)
    points = image.vertices[:, [image.problem.axes.index(axis) for axis in axes]]
    if len(axes) == 1:
        expected = np.ptp(points)
    else:
        found, factor = hull(points)
        expected = found.volume * factor
        assert len(found.vertices) == len(shadow.vertices)
    assert shadow.volume == pytest.approx(expected, rel=1e-9)
    normals, offsets = shadow.facets
    assert (points @ normals.T - offsets).max() <= 1e-9 * np.abs(points).max()


@pytest.mark.parametrize('k', [1, 2, 3])
@pytest.mark.parametrize('case', SETS)
def test_a_section_is_the_intersection_of_half_spaces(case, k):
    image, rng = set_of(case)
    axes, (at,) = axes_of(image, rng, k), image.sample(rng, 1)
    cut = image.section(axes, at)
    rows = [image.problem.axes.index(axis) for axis in axes]
    others = [i for i in range(len(at)) if i not in rows]
    normals, offsets = image.facets
    left = offsets - normals[:, others] @ at[others]
    cutting = np.linalg.norm(normals[:, rows], axis=1) > 1e-9
    scale = np.ptp(image.vertices[:, rows], axis=0)
    planes = normals[cutting][:, rows] * scale
    if len(axes) == 1:
        ends = [linprog([sign], A_ub=planes, b_ub=left[cutting], bounds=(None, None)).fun
                for sign in (1.0, -1.0)]
        expected = -(ends[0] + ends[1]) * scale[0]
    else:
        halfspaces = np.column_stack([planes, -left[cutting]])
        corners = HalfspaceIntersection(halfspaces, at[rows] / scale).intersections
        expected = ConvexHull(corners).volume * scale.prod()
    assert cut.volume == pytest.approx(expected, rel=1e-8 if k == 3 else 1e-9)
    # The vertices are on the boundary of the set.
    wrenches = np.tile(at, (len(cut.vertices), 1))
    wrenches[:, rows] = cut.vertices
    assert np.abs(image.margin(wrenches)).max() <= 1e-9 * np.abs(image.vertices).max()


def test_a_box_by_hand():
    box = AdmissibleSet(AllocationProblem(
        np.eye(3), [-1.0, -2.0, 0.0], [1.0, 2.0, 3.0], axes=['x', 'y', 'z']))
    assert len(box.vertices) == 8
    cut = box.section(['y', 'x'], at=[0.0, 0.0, 1.0])
    assert cut.axes == ('y', 'x')
    np.testing.assert_allclose(cut.vertices, [[-2, -1], [2, -1], [2, 1], [-2, 1]], atol=1e-12)
    assert cut.volume == pytest.approx(8.0)
    normals, offsets = cut.facets
    np.testing.assert_allclose(normals, [[0, -1], [1, 0], [0, 1], [-1, 0]], atol=1e-12)
    np.testing.assert_allclose(offsets, [1, 2, 1, 2], atol=1e-12)
    assert box.authority([0.5, 0.0, 1.0]) == {
        'x': (-1.0, 1.0), 'y': (-2.0, 2.0), 'z': (0.0, 3.0)}


def test_beside_the_set_there_is_nothing():
    box = AdmissibleSet(AllocationProblem(np.eye(3), -1.0, 1.0, axes=['x', 'y', 'z']))
    for axes in (['x'], ['x', 'y']):
        cut = box.section(axes, at=[0.0, 0.0, 2.0])
        assert cut.empty
        assert cut.volume == 0.0
        with pytest.raises(ValueError, match='no facets'):
            _ = cut.facets
    slanted = AdmissibleSet(AllocationProblem(
        [[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [1.0, 0.0, 1.0]], 0.0, 1.0, axes=['x', 'y', 'z']))
    assert slanted.section(['x', 'y', 'z']).volume == pytest.approx(slanted.volume)
    assert slanted.section(['x', 'y'], at=[0.0, 0.0, 5.0]).empty
    low, high = slanted.authority([1.0, 1.0, 5.0])['x']
    assert np.isnan(low)
    assert np.isnan(high)


@pytest.mark.parametrize('axes', [[], ['x', 'x'], ['w'], 'xy'])
def test_wrong_axes_are_named(axes):
    box = AdmissibleSet(AllocationProblem(np.eye(2), -1.0, 1.0, axes=['x', 'y']))
    for cut in (box.section, box.projection):
        with pytest.raises(ValueError, match='axes: expected different ones of x, y'):
            cut(axes)


def test_the_volumes_of_the_f18_harv_have_the_published_ratio():
    # Bordignon, example 5-2: the pseudo-inverse keeps the limits in 13.7 % of the volume.
    harv = AllocationProblem.load('harv')
    image = AdmissibleSet(harv)
    corners = np.array(list(product(*zip(harv.lower, harv.upper, strict=True)))) @ harv.gamma.T
    assert hull(image.vertices)[0].volume == pytest.approx(hull(corners)[0].volume, rel=1e-9)
    attainable = ConvexHull(image.vertices).volume
    assert attainable == pytest.approx(image.volume, rel=1e-9)
    inverse = np.linalg.pinv(harv.gamma)
    limits = np.column_stack([np.vstack([inverse, -inverse]), [*-harv.upper, *harv.lower]])
    kept = ConvexHull(HalfspaceIntersection(limits, np.zeros(3)).intersections).volume
    assert round(100.0 * kept / attainable, 1) == 13.7
