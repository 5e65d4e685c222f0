"""Vectors in convex sets: laws of the sets, and answers against Clarabel's cone programs."""

from os import environ

import numpy as np
import pytest
from scipy import sparse

from ca_ros import (
    AdmissibleSet,
    AllocationProblem,
    Interval,
    ParameterError,
    Sector,
    Vehicle,
    make_allocator,
)
from ca_ros.allocation.box_backend import kernel_for
from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.allocation.tilt_rates import TiltLimited
from ca_ros.kernel.vectored import sets_newton
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.solver.convex_sets import ConvexSets
from ca_ros.solver.least_norm_over_sets import SetsNewton
from ca_ros.vehicle.files import read, shipped_tilting
from ca_ros.vehicle.settings import AXES
from strategies import length, seeded

clarabel = pytest.importorskip('clarabel', reason="needs the extra 'test'")

pytestmark = pytest.mark.slow

WRENCHES = int(environ.get('VECTORED_WRENCHES', length('12', '40')))
"""Attainable wrenches for each problem, and a tenth as many beyond it.

VECTORED_WRENCHES=10000 pytest -s test/test_vectored.py -k 'least_cost or cone_program or after'
prints the greatest errors of 10 000 and 1000; most of the time Clarabel takes.
"""

BEYOND_SETS = max(length(1, 3), WRENCHES // 10)

SETS = [
    Interval(-1.0, 2.0), Sector(0.5, 3.0), Sector(np.pi / 2, 2.0, 3), Sector(1.2, 2.0, 3, 0.3),
    Sector(np.pi, 1.5), Sector(np.pi, 1.0, 3), Sector(0.4, 4.0, 2, 0.2), Sector(1.55, 4.0, 2, 0.5),
]


def random_problem(seed):
    sets = [
        Interval(-2.0, 3.0), Sector(0.7, 3.0), Sector(1.2, 2.0, 3, 0.2), Sector(np.pi, 2.0),
        Sector(np.pi / 2, 3.0, 3), Interval(0.0, 4.0), Sector(0.3, 5.0, 2, 0.3),
    ]
    sets = [sets[(seed * k) % 7] for k in range(1, 8)] if seed > 1 else sets
    size = sum(each.size for each in sets)
    matrix = seeded(seed).normal(size=(6, size))
    axes = ['force_x', 'force_y', 'thrust', 'roll', 'pitch', 'yaw']
    return AllocationProblem(matrix, axes=axes, sets=sets)


PROBLEMS = {f'random {seed}': random_problem(seed) for seed in (1, 3)} | {
    name: VehicleProblem(Vehicle.load(name))
    for name in ('hexarotor_tilting', 'omnidirectional_gimbals', 'tricopter', 'azimuth_boat')
}


def cones(sets, extra=0):
    """Return A, b and the cones of Clarabel (``b - A x`` in the cones) for vectors in sets."""
    rows, right, kinds = [], [], []
    width = sets.n + extra
    eye = np.eye(width)
    for each, k in zip(sets.sets, sets.first, strict=True):
        if isinstance(each, Interval):
            rows += [eye[k], -eye[k]]
            right += [each.upper, -each.lower]
            kinds.append(clarabel.NonnegativeConeT(2))
            continue
        place = range(k, k + each.size)
        rows += [np.zeros(width), *(-eye[place])]
        right += [each.radius, *np.zeros(each.size)]
        kinds.append(clarabel.SecondOrderConeT(1 + each.size))
        if each.half_angle <= np.pi / 2:
            slope = np.sin(each.half_angle), np.cos(each.half_angle)
            rows += [-slope[0] * eye[k], *(-slope[1] * eye[range(k + 1, k + each.size)])]
            right += [0.0] * each.size
            kinds.append(clarabel.SecondOrderConeT(each.size))
            rows.append(-eye[k])
            right.append(-each.least)
            kinds.append(clarabel.NonnegativeConeT(1))
    return rows, right, kinds


def clarabel_minimum(sets, matrix, goal, linear, curvature, bounds=()):
    """Return the point of least cost, with more variables in bounds after those of the sets."""
    rows, right, kinds = cones(sets, len(bounds))
    eye = np.eye(sets.n + len(bounds))
    for i, (low, high) in enumerate(bounds):
        rows += [eye[sets.n + i], -eye[sets.n + i]]
        right += [high, -low]
        kinds.append(clarabel.NonnegativeConeT(2))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(np.diag(curvature)), linear,
        sparse.csc_matrix(np.vstack([matrix, rows])), np.concatenate([goal, right]),
        [clarabel.ZeroConeT(len(goal)), *kinds], settings,
    )
    return np.array(solver.solve().x)


@pytest.mark.parametrize('scale', [0.3, 3.0, 30.0])
def test_projection_is_nearest_and_its_derivative_true(scale):
    sets, rng = ConvexSets(SETS), seeded(0)
    points, ways = scale * rng.normal(size=(2, 500, sets.n))
    nearest, rate = sets.project_with_derivative(points)
    # The plane through the nearest point, normal to the way to it, touches the set.
    out = points - nearest
    assert np.abs(sets.support(out) - (out * nearest).sum(axis=1)).max() < 1e-12 * scale**2
    np.testing.assert_allclose(sets.project(nearest), nearest, atol=2e-15)
    np.testing.assert_array_equal(sets.project(points), nearest)
    moved = (sets.project(points + 1e-7 * ways) - sets.project(points - 1e-7 * ways)) / 2e-7
    expected = np.einsum('kij,kj->ki', rate, ways)
    # A kink within the step is rare.
    assert np.quantile(np.abs(moved - expected).max(axis=1), 0.99) < 1e-5 * scale
    farthest = sets.farthest(points)
    np.testing.assert_allclose((farthest * points).sum(axis=1), sets.support(points), rtol=1e-12)
    np.testing.assert_allclose(sets.project(farthest), farthest, atol=2e-15)


def test_hand_computed_projections():
    sector = ConvexSets([Sector(np.pi / 4, 2.0, 2, 1.0)])
    for point, nearest in {
        (3.0, 0.0): (2.0, 0.0),
        (3.0, 3.0): (np.sqrt(2.0), np.sqrt(2.0)),
        (1.0, 1.4): (1.2, 1.2),
        (0.0, 0.5): (1.0, 0.5),
        (-1e9, 0.5): (1.0, 0.5),  # where rounded distances to flank and plane are equal
        (0.0, -1.5): (1.0, -1.0),
        (1.2, 0.3): (1.2, 0.3),
    }.items():
        np.testing.assert_allclose(sector.project(np.array(point)), nearest, atol=1e-15)
    disc = ConvexSets([Sector(np.pi, 2.0)])
    np.testing.assert_allclose(disc.project(np.array([-3.0, 4.0])), [-1.2, 1.6], atol=1e-15)


@pytest.mark.parametrize(('kind', 'values', 'fault'), [
    (Interval, (2.0, 1.0), 'lower <= upper'),
    (Sector, (2.0, 1.0), 'half_angle'),
    (Sector, (0.5, -1.0), 'radius'),
    (Sector, (0.5, 1.0, 4), 'size'),
    (Sector, (np.pi, 1.0, 2, 0.1), 'least'),
])
def test_wrong_sets_are_named(kind, values, fault):
    with pytest.raises(ValueError, match=fault):
        kind(*values)


@pytest.mark.parametrize('name', PROBLEMS)
def test_attainable_wrenches_are_met_at_the_least_cost(name):
    problem, rng = PROBLEMS[name], seeded(2)
    sets = problem.sets
    vectors = sets.project(rng.uniform(1.3 * sets.lower, 1.3 * sets.upper, (WRENCHES, sets.n)))
    wrenches = vectors @ problem.gamma.T
    answers = make_allocator('exact', problem).allocate_batch(wrenches)
    size = np.maximum(1.0, np.linalg.norm(wrenches, axis=1))
    assert (answers.status == 0).all()
    assert (np.linalg.norm(answers.residual, axis=1) <= 1e-12 * size).all()
    certificate = answers.certificate
    assert np.max(certificate.bound_violation) < 1e-14
    assert np.max(certificate.kkt_residual) < 1e-9
    costs = (answers.thrusts**2).sum(axis=1)
    assert (np.abs(certificate.gap) <= 1e-10 * np.maximum(1.0, costs)).all()
    n = sets.n
    points = np.array([
        clarabel_minimum(sets, problem.gamma, u, np.zeros(n), 2.0 * np.ones(n)) for u in wrenches
    ])
    others = (points**2).sum(axis=1)
    cheaper = (costs - others) / np.maximum(1.0, others)
    # An answer that misses the wrench or leaves the sets may cost less by so much.
    missed = np.linalg.norm(wrenches - points @ problem.gamma.T, axis=1)
    missed += np.linalg.norm(problem.gamma, 2) * np.linalg.norm(
        points - sets.project(points), axis=1)
    assert (cheaper < 1e-9 + 2.0 * np.linalg.norm(certificate.multipliers, axis=1) * missed).all()
    # Clarabel itself stops short of 1e-9 for few wrenches; its answers then cost more.
    assert np.mean(cheaper > -1e-9) > 0.9
    short = (np.linalg.norm(answers.residual, axis=1) / size).max()
    print(
        f'{name}: residual / max(1, |u|) {short:.1e}, cost '
        f'{cheaper.max():.1e} above and {-cheaper.min():.1e} below that of Clarabel, which misses '
        f'up to {missed.max():.1e} ({np.mean(cheaper > -1e-9):.4f} within 1e-9); certificate: KKT '
        f'{np.max(certificate.kkt_residual):.1e}, '
        f'gap {np.max(np.abs(certificate.gap) / np.maximum(1.0, costs)):.1e} of the cost'
    )


@pytest.mark.parametrize('name', sorted(shipped_tilting()))
def test_certificates_inside_the_set_and_on_its_boundary(name):
    allocator = make_allocator('exact', Vehicle.load(name))
    problem = allocator.problem
    inside = AdmissibleSet(problem).sample(seeded(5), 20 * WRENCHES)
    far = problem.reference + 3.0 * (inside - problem.reference)
    for wrenches, kkt, gap in ((inside, 1e-10, 1e-10), (far, 1e-4, 1e-4)):
        answers = allocator.allocate_batch(wrenches)
        certificate = answers.certificate
        assert certificate.kkt_residual.max() < kkt
        costs = (answers.thrusts**2).sum(axis=1) / 2.0
        assert (certificate.gap <= gap * np.maximum(1.0, costs)).all()


@pytest.mark.parametrize('name', PROBLEMS)
def test_scale_reaches_the_level_of_a_cone_program(name):
    problem, rng = PROBLEMS[name], seeded(3)
    allocator = make_allocator('exact', problem, policy='scale')
    start = AdmissibleSet(problem).reference
    levels, gaps, dear, aside = [], [], [], []
    for _ in range(BEYOND_SETS):
        u = start + 2.0 * problem.extent * rng.normal(size=len(start))
        answer = allocator.allocate(u)
        matrix = np.column_stack([problem.gamma, start - u])
        linear = np.append(np.zeros(problem.n), -1.0)
        best = clarabel_minimum(
            problem.sets, matrix, start, linear, np.zeros(problem.n + 1), bounds=[(0.0, 1.0)]
        )[-1]
        levels.append(abs(answer.level - best))
        line = problem.program.least_norm.line(start, u - start, 1.0)
        gaps.append(abs(line.most - answer.level))
        on_line = start + answer.level * (u - start)
        aside.append(np.abs(answer.wrench - on_line).max() / np.linalg.norm(u))
        # Near the boundary multipliers are great, and so is the cost of a rounded wrench.
        multipliers = answer.certificate.multipliers
        rounding = np.linalg.norm(multipliers) * problem.tolerance(answer.wrench)
        cost = max(1.0, (answer.thrusts**2).sum())
        gap = abs(float(answer.certificate.gap))
        dear.append((gap / (1e-5 * cost + 10.0 * rounding), gap / cost))
        assert np.max(answer.certificate.bound_violation) < 1e-14
    print(f'{name}: level {max(levels):.1e} from that of Clarabel, own gap {max(gaps):.1e}; '
          f'{max(aside):.1e} |u| off the line, {np.mean(np.array(aside) > 1e-9):.4f} above 1e-9; '
          f'cost: gap / bound and gap / cost up to {np.max(dear, axis=0)}')
    assert max(levels) < 1e-7
    assert max(gaps) < 1e-9
    assert max(aside) < 1e-9
    assert np.max(dear, axis=0)[0] <= 1.0


def test_lines_to_corners_are_as_long_as_their_planes_prove():
    """At corners there are many normals, and rounding must not choose one that is none."""
    problem, rng = PROBLEMS['hexarotor_tilting'], np.random.default_rng(0)
    solver, begin = problem.program.least_norm, AdmissibleSet(problem).reference
    for way in np.round(2.0 * rng.normal(size=(length(4000, 40_000), 6))) / 2.0:
        line = solver.line(begin, problem.extent * way, 100.0)
        assert abs(line.most - line.length) <= 1e-9 * line.length, way


def test_scale_begins_at_the_middle_if_the_reference_is_a_corner():
    """From a corner most lines leave the set at once, and nothing would be served."""
    problem = AllocationProblem(np.eye(2), sets=[Sector(0.5, 2.0)])
    u = np.array([1.0, 3.0])
    line = problem.program.least_norm.line(np.zeros(2), u, 1.0)
    assert line.length == pytest.approx(0.0, abs=1e-6)
    answer = make_allocator('exact', problem, policy='scale').allocate(u)
    inner = AdmissibleSet(problem).center
    way, served = u - inner, answer.wrench - inner
    assert way[0] * served[1] == pytest.approx(way[1] * served[0], abs=1e-9)
    assert served @ way > 0.0
    assert answer.wrench[1] == pytest.approx(np.tan(0.5) * answer.wrench[0], abs=1e-8)


@pytest.mark.parametrize('seed', range(length(20, 200)))
def test_scale_begins_at_an_attainable_wrench_and_stays_on_its_line(seed):
    """The middles of the ranges of the axes may be outside of the set together."""
    rng = seeded(seed)
    sets = [Sector(rng.uniform(0.1, 1.5), rng.uniform(0.5, 9.0), 3) for _ in range(2)]
    problem = AllocationProblem(rng.normal(size=(5, 6)), sets=sets)
    exact = make_allocator('exact', problem, policy='scale', residual_slack=0.0)
    begin = AdmissibleSet(exact.problem).reference
    assert exact.allocate(begin).status.name == 'EXACT'
    for u in begin + rng.normal(size=(10, 5)) * exact.problem.extent:
        answer, way = exact.allocate(u), u - begin
        share = (answer.wrench - begin) @ way / (way @ way)
        np.testing.assert_allclose(answer.wrench, begin + share * way, rtol=0.0, atol=1e-9)
        if answer.status.name == 'SCALED':
            assert exact.allocate(begin + (share + 2e-9) * way).status.name != 'EXACT'


def test_scale_stays_on_its_line_at_the_tip_of_a_half_disc():
    """Where the vector of a sector vanishes, the pulls along a line lose it."""
    problem = AllocationProblem([
        [0.1, -0.15, 0.1, 0.26, 0.2, 0.36, -0.043, -0.078],
        [-2.5, -5.3, 2.4, 1.7, -0.82, -2.3, -2.6, 2.0],
        [-0.047, -0.089, -0.11, -0.14, 0.29, -0.044, -0.14, 0.2],
        [17.0, 20.0, 3.9, 24.0, 7.5, -7.2, 28.0, -33.0],
        [-3.2, 0.087, 0.082, 4.5, 2.1, -2.4, -0.3, -0.3],
    ], sets=[Sector(np.pi / 2, 0.304), Sector(np.pi / 2, 1.267, 3), Sector(0.735, 0.557, 3)])
    exact = make_allocator('exact', problem, policy='scale', residual_slack=0.0)
    begin, rng = AdmissibleSet(problem).reference, seeded(0)
    reference = SetsNewton(problem.gamma, problem.sets)
    normals = rng.normal(size=(length(400, 6000), 5))
    ends = problem.sets.farthest(normals @ problem.gamma) @ problem.gamma.T
    for i, u in enumerate(ends * rng.choice([1.0 + 1e-9, 1.0 + 1e-6, 1.0 + 1e-5], (len(ends), 1))):
        answer, way = exact.allocate(u), u - begin
        share = (answer.wrench - begin) @ way / (way @ way)
        off = answer.wrench - begin - share * way
        assert np.abs(off / problem.extent).max() < 2e-9
        if i % 50 == 0:
            line = reference.line(begin, way, 1.0)
            off = problem.gamma @ line.point - begin - line.length * way
            assert np.abs(off / problem.extent).max() < 2e-9
            assert line.length == pytest.approx(share, abs=2e-9)


@pytest.mark.parametrize('name', PROBLEMS)
def test_prioritize_serves_one_axis_after_the_other(name):
    """Step by step Clarabel serves no more; it may move the axes before by 1e-11 of their range.

    On a curved boundary this alone is worth up to the fourth root of it.
    """
    problem, rng = PROBLEMS[name], seeded(4)
    order = [['roll'], ['thrust'], ['yaw'], ['pitch'], ['force_x'], ['force_y']]
    order = [group for group in order if group[0] in problem.axes]
    allocator = make_allocator('exact', problem, order=order, axis_reversal='allow')
    further = []
    for _ in range(BEYOND_SETS):
        u = problem.center + 1.5 * problem.extent * rng.normal(size=len(problem.axes))
        answer = allocator.allocate(u)
        held = []
        for (axis,) in order:
            row = problem.axes.index(axis)
            sign = np.sign(u[row] - answer.wrench[row])
            if abs(answer.wrench[row] - u[row]) > 1e-6 * problem.extent[row]:
                bounds = [(-w, w) for w in 1e-11 * problem.extent[held]]
                matrix = np.hstack([problem.gamma[held], -np.eye(len(held))])
                linear = np.append(-sign * problem.gamma[row], np.zeros(len(held)))
                best = clarabel_minimum(
                    problem.sets, matrix, answer.wrench[held], linear, np.zeros(len(linear)),
                    bounds=bounds,
                )[: problem.n]
                more = sign * (problem.gamma[row] @ best - answer.wrench[row])
                further.append(more / problem.extent[row])
            held.append(row)
    quantiles = np.quantile(further, [0.5, 0.99, 0.999])
    print(f'{name}: Clarabel serves {max(further):.1e} of half a range more, in one of 2, 100, '
          f'1000 steps {quantiles}, least {min(further):.1e}; {len(further)} steps')
    assert min(further) > -1e-6
    assert max(further) < 3e-3


@pytest.mark.parametrize('engine', [sets_newton, SetsNewton])
def test_thin_sectors_are_solved(engine):
    """Along a step of Newton's method the slope falls from its first value to a negative one."""
    sets = [Sector(1e-3, 1.0, 3, 0.9), Sector(1e-6, 4.0, 2), Sector(1.0, 1.0, 2)]
    for seed in range(3):
        rng = seeded(seed)
        problem = AllocationProblem(rng.normal(size=(4, 7)), sets=sets)
        low, high = 1.3 * problem.lower, 1.3 * problem.upper
        wrenches = problem.clip(rng.uniform(low, high, (20, 7))) @ problem.gamma.T
        solver = engine(problem.gamma, problem.sets)
        found = solver.solve(wrenches)
        assert found.attained.all()
        least = solver.least_norm(found.multipliers)
        missed = ((wrenches - least @ problem.gamma.T) * found.multipliers).sum(axis=1)
        costs = [0.5 * (points**2).sum(axis=1) for points in (found.points, least)]
        assert np.abs(costs[0] - costs[1] - missed).max() < 1e-9


def test_margin_and_sections_are_bounded_from_both_sides():
    """Of a ball, and of a sphere's shadow, everything is known by hand."""
    problem = AllocationProblem(np.eye(3), sets=[Sector(np.pi, 2.0, 3)])
    admissible = AdmissibleSet(problem)
    low, high = problem.attainable_set.margin_bounds(np.array([0.5, 0.0, 0.0]))
    assert low <= 1.5 + 1e-8
    assert high == pytest.approx(1.5, abs=1e-6)
    assert admissible.margin([3.0, 4.0, 0.0]) == pytest.approx(-3.0, abs=1e-7)
    np.testing.assert_array_equal(admissible.contains([[1.9, 0, 0], [2.1, 0, 0]]), [True, False])
    points = admissible.section(['axis_1', 'axis_2'], [0.0, 0.0, 1.0]).vertices
    np.testing.assert_allclose(np.hypot(*points.T), np.sqrt(3.0), rtol=1e-7)
    assert admissible.section(['axis_1', 'axis_2'], [0.0, 0.0, 2.1]).empty
    drawn = admissible.sample(seeded(0), 500)
    assert np.linalg.norm(drawn, axis=1).max() <= 2.0 + 1e-9


def drawn_sets(rng):
    """Return a matrix and sets of several sizes; some sectors begin at `least`."""
    sets = []
    for _ in range(rng.integers(2, 7)):
        kind, radius = rng.integers(4), float(10.0 ** rng.uniform(-1.0, 1.0))
        if kind == 0:
            sets.append(Interval(float(rng.choice([0.0, -radius])), radius))
        elif kind == 3:
            sets.append(Sector(np.pi, radius, int(rng.integers(2, 4))))
        else:
            angle = float(min(rng.uniform(0.05, 2.0), np.pi / 2))
            least = radius * float(rng.choice([0.0, 0.01, 0.1, 0.5, 0.9]))
            sets.append(Sector(angle, radius, int(1 + kind), least))
    made = ConvexSets(sets)
    return rng.normal(size=(rng.integers(1, min(6, made.n) + 1), made.n)), made


@pytest.mark.parametrize('engine', [sets_newton, SetsNewton])
def test_vectors_stay_in_their_sets_and_multipliers_finite(engine):
    """Wrenches on the boundary, or just beyond it, where no multipliers exist."""
    rng = seeded(WRENCHES)
    for _ in range(length(100, 3000) if engine is sets_newton else length(5, 50)):
        matrix, sets = drawn_sets(rng)
        middle, wrenches = matrix @ sets.middle, []
        for _ in range(12 if engine is sets_newton else length(3, 12)):
            edge = matrix @ sets.farthest(rng.normal(size=len(matrix)) @ matrix)
            wrenches += [middle + share * (edge - middle)
                         for share in (1.0 - 1e-9, 1.0, 1.0 + 1e-12, 1.0 + 1e-6, 3.0, -2.0)]
        found = engine(matrix, sets).solve(np.array(wrenches))
        outside = np.abs(found.points - sets.project(found.points)).max()
        assert outside < 1e-9, sets.sets
        assert np.abs(found.multipliers).max() < 1e60, sets.sets
        reached = found.points @ matrix.T
        left = np.linalg.norm(reached - wrenches, axis=1)
        assert left[found.attained].max(initial=0.0) < 1e-9, sets.sets
        assert found.unattainable[4::6].all(), sets.sets


@pytest.mark.parametrize('name', ['hexarotor_tilting', 'tricopter', 'azimuth_boat'])
def test_an_outline_leaves_out_less_than_a_thousandth_of_the_range(name):
    """All attainable points of the plane: found by lines in directions that are drawn."""
    problem, rng = PROBLEMS[name], seeded(7)
    admissible = AdmissibleSet(problem)
    for axes in (problem.axes[:2], problem.axes[-2:], problem.axes[1:3]):
        rows, start = [problem.axes.index(axis) for axis in axes], admissible.reference
        corners = admissible.section(axes).vertices
        size = np.ptp(corners, axis=0)
        edges = (np.roll(corners, -1, axis=0) - corners) / size
        away = np.column_stack([edges[:, 1], -edges[:, 0]])
        away /= np.linalg.norm(away, axis=1)[:, None]
        for angle in rng.uniform(0.0, 2.0 * np.pi, 200):
            way = np.zeros(len(start))
            way[rows] = np.array([np.cos(angle), np.sin(angle)]) * size
            end = start + problem.program.least_norm.line(start, way).length * way
            beyond = (((end[rows] - corners) / size) * away).sum(axis=1).max()
            assert beyond < 1.1e-3, (axes, angle)


def test_a_duality_gap_is_not_negative():
    problem, rng = PROBLEMS['hexarotor_tilting'], seeded(11)
    exact = make_allocator('exact', problem)
    drawn = AdmissibleSet(problem).sample(rng, 200)
    assert all(exact.allocate(u).certificate.gap >= 0.0 for u in drawn)


def test_other_methods_name_what_they_cannot_take():
    problem = PROBLEMS['random 1']
    with pytest.raises(ParameterError, match='exact, pseudo_inverse, '):
        make_allocator('direct', problem)
    with pytest.raises(TypeError, match='vectors in sets'):
        AdmissibleSet(problem).volume  # noqa: B018


@pytest.mark.parametrize('name', list(PROBLEMS)[2:])
def test_speeds_and_angles_give_the_wrench(name):
    """The forces of the rotors in the body frame, from speeds and servo angles alone."""
    vehicle = Vehicle.load(name)
    problem, allocator = VehicleProblem(vehicle), make_allocator('exact', vehicle)
    rng = seeded(5)
    low, high = vehicle.servos.limits
    vectors = rng.uniform(1.3 * problem.lower, 1.3 * problem.upper, (20, problem.n))
    for u in problem.clip(vectors) @ problem.gamma.T:
        answer = allocator.allocate(u)
        angles = answer.angles
        assert (low <= angles).all()
        assert (angles <= high).all()
        assert (vehicle.speed_limits[0] <= answer.speeds).all()
        assert (answer.speeds <= vehicle.speed_limits[1]).all()
        forces = vehicle.thrusts(answer.speeds)[:, None] * vehicle.servos.directions(angles)
        ratios = vehicle.spins * vehicle.torque_coefficient / vehicle.thrust_coefficient
        torques = np.cross(vehicle.arms, forces) + ratios[:, None] * forces
        full = dict(zip(AXES, [*forces.sum(axis=0), *torques.sum(axis=0)], strict=True))
        np.testing.assert_allclose([full[axis] for axis in vehicle.axes], u, atol=1e-11)


@pytest.mark.parametrize(('name', 'value', 'fault'), [
    ('tilt_max', 4.0, 'half a circle'),
    ('tilt_max', 8.0, 'half a circle'),
    ('tilt_min', 2.0, 'above tilt_max'),
    ('tilt_axes', [0.0, 0.0, 1.0], 'normal to rotors.axes'),
    ('tilt_axes', [1.0, 0.0], 'expected 3 or 18'),
    ('gimbal', 0.3, 'one of them'),
    ('speed_min', -100.0, 'expected at least 0'),
    ('speed_min', 400.0, 'rotors.speed_min: 400 rad/s of rotor 1, which tilts; expected less'),
])
def test_tilts_that_make_no_convex_sets_are_refused(name, value, fault):
    given = read('hexarotor_tilting') | {f'rotors.{name}': value}
    with pytest.raises(ParameterError, match=fault):
        Vehicle.from_parameters(given)


def turn(before, after):
    """Return by how much angles change, the shorter way."""
    return np.abs((after - before + np.pi) % (2.0 * np.pi) - np.pi)


BEYOND = [2.26777, 15.01897, 9.66983, -2.55439, 1.86059, 4.72231]
"""A demand on hexarotor_tilting for which a later step touches a curved boundary."""


@pytest.mark.parametrize('name', ['hexarotor_tilting', 'omnidirectional_gimbals', 'tricopter'])
def test_roll_and_pitch_keep_their_direction_far_beyond_the_set(name):
    rng, allocator = seeded(3), make_allocator('exact', Vehicle.load(name))
    problem = allocator.problem
    if problem.program.least_norm.engine != 'C':
        pytest.skip('NumPy takes seconds for these')
    rows = [problem.axes.index('roll'), problem.axes.index('pitch')]
    ways = rng.normal(size=(length(3, 20), len(problem.axes))) * problem.extent
    demands = [problem.center + share * way for way in ways for share in np.linspace(0.2, 2.5, 60)]
    if name == 'hexarotor_tilting':
        demands += [share * np.array(BEYOND) for share in np.linspace(0.999, 1.001, 21)]
    for demand in demands:
        served, limit = allocator.allocate(demand).wrench, problem.extent[rows].max()
        (x, y), (a, b) = (served - problem.reference)[rows], (demand - problem.reference)[rows]
        assert abs(x * b - y * a) < 1e-6 * np.hypot(a, b) * limit
        assert x * a + y * b >= 0.0


@pytest.mark.parametrize('engine', ['c', 'numpy'])
def test_servos_within_their_rates_cross_zero_thrust_without_error(engine, monkeypatch):
    """Two thrusters of the boat pass through zero thrust; their exact angles jump there."""
    if engine == 'c' and PROBLEMS['azimuth_boat'].program.least_norm.engine != 'C':
        pytest.skip('the extension module is not built')
    monkeypatch.setenv('CA_ROS_KERNEL', engine)
    vehicle, period = Vehicle.load('azimuth_boat'), 0.05
    exact, limited = make_allocator('exact', vehicle), TiltLimited(vehicle, 400.0, 3.0)
    inverse = np.linalg.pinv(exact.problem.gamma)
    side = -4.0 * (inverse @ [0.0, 0.0, 8.0])[1] + 0.02

    def demand(time):
        return np.array([16.0 * np.cos(time), side, 8.0])

    last = exact.allocate(demand(0.0))
    speeds, angles, jumps = last.speeds, last.angles, []
    for time in np.arange(0.0, 3.2, period):
        answer = limited.allocate(demand(time), speeds, angles, period)
        assert turn(angles, answer.angles).max() <= 3.0 * period + 1e-12
        assert np.abs(answer.speeds - speeds).max() <= 400.0 * period + 1e-9
        assert answer.status.name == 'EXACT'
        assert np.linalg.norm(answer.residual) < 1e-11
        speeds, angles = answer.speeds, answer.angles
        jumps.append(exact.allocate(demand(time)).angles)
    assert np.abs(np.diff(jumps, axis=0)).max() > 1.5


@pytest.mark.parametrize('period', [np.nan, np.inf, -1.0])
def test_a_wrong_period_is_named(period):
    limited = TiltLimited(Vehicle.load('azimuth_boat'), 500.0, 3.0)
    with pytest.raises(ParameterError, match=f'period: expected 0 s or more, .* got {period}'):
        limited.allocate(np.zeros(3), np.full(4, 100.0), np.zeros(4), period)


@pytest.mark.parametrize(('name', 'u', 'rates', 'status', 'words'), [
    ('azimuth_boat', [9.5, 3.0, 0.0], (400.0, 3.0), 'EXACT', ''),
    # Backwards at once: the servos cannot turn by half a circle.
    ('azimuth_boat', [-8.0, 3.0, 0.0], (1e6, 3.0), 'RATE_LIMITED',
     'rotors 1, 2, 3, 4 at their tilt rate'),
    ('azimuth_boat', [60.0, 18.0, 0.0], (100.0, 1e4), 'RATE_LIMITED', 'rotors 1, 2, 3, 4 at'),
    ('tricopter', [60.0, 0.0, 0.0, 0.0], (100.0, 1e4), 'RATE_LIMITED', 'at their rate'),
    # No rate limits these: they are out of reach.
    ('hexarotor_tilting', [1e3] * 6, (1e6, 1e4), 'PRIORITIZED', '1 at its greatest tilt and'),
    ('omnidirectional_gimbals', [1e3] * 6, (1e6, 1e4), 'PRIORITIZED', '7 at their greatest tilt'),
])
def test_what_a_rate_limits_is_named(name, u, rates, status, words):
    vehicle = Vehicle.load(name)
    exact, limited = make_allocator('exact', vehicle), TiltLimited(vehicle, *rates)
    begin = [10.0, 3.0, 0.0] if len(u) == 3 else 0.5 * exact.problem.center
    last = exact.allocate(begin)
    answer = limited.allocate(u, last.speeds, last.angles, 0.02)
    assert answer.status.name == status
    said = answer.explanation.limits
    assert not said if status == 'EXACT' else words in ''.join(said.values())
    assert ('rate' in ''.join(said.values())) == (status == 'RATE_LIMITED')


@pytest.mark.parametrize('name', length(['azimuth_boat'], list(PROBLEMS)[2:]))
def test_any_command_is_reached_within_the_rates(name):
    """The wrench of a command within the rates is attainable in the next step, or nearly so."""
    vehicle, rng = Vehicle.load(name), seeded(6)
    limited = TiltLimited(vehicle, 500.0, 2.0)
    low, high = vehicle.servos.limits
    for _ in range(length(3, 10)):
        speeds = rng.uniform(*vehicle.speed_limits)
        angles = rng.uniform(low, high)
        if vehicle.servos.gimbal.any():
            angles *= 0.5
        u = VehicleProblem(vehicle).center + rng.normal(size=len(vehicle.axes))
        answer = limited.allocate(u, speeds, angles, 0.02)
        assert np.abs(answer.speeds - speeds).max() <= 500.0 * 0.02 + 1e-9
        assert turn(angles, answer.angles).max() <= 2.0 * 0.02 + 1e-9
        # To hold the command is in the sets.
        forces = vehicle.thrusts(speeds)[:, None] * vehicle.servos.directions(angles)
        problem = answer.problem
        held = np.concatenate([
            problem.directions[k : k + each.size] @ force
            for each, k, force in zip(problem.sets.sets, problem.sets.first, forces, strict=True)
        ])
        assert np.abs(held - problem.clip(held)).max() < 1e-9


@pytest.mark.parametrize('name', length(['tricopter'], PROBLEMS))
def test_baselines_keep_angles_and_thrusts(name):
    problem, rng = PROBLEMS[name], seeded(7)
    wrenches = problem.center + problem.extent * rng.normal(size=(10, len(problem.axes)))
    low, high = problem.sets.length_limits
    clipped = make_allocator('pseudo_inverse', problem).allocate_batch(wrenches)
    least = np.array([isinstance(each, Interval) for each in problem.sets.sets])
    sizes = np.where(least, 0.0, problem.sets.sizes(clipped.thrusts))
    assert (sizes <= np.where(least, 0.0, high) + 1e-12).all()
    assert (sizes >= np.where(least, 0.0, low) - 1e-12).all()
    # Weighted least squares costs less than the answer of any other method.
    weighted = make_allocator('weighted_least_squares', problem, gamma=100.0, wv=1.0)
    exact = make_allocator('exact', problem)
    half = problem.half_range[problem.sets.first][problem.sets.owners]
    for u in wrenches:
        answers = [method.allocate(u) for method in (weighted, exact)]
        costs = [
            ((a.thrusts / half)**2).sum() + 100.0 * ((a.residual / problem.extent)**2).sum()
            for a in answers]
        assert costs[0] <= costs[1] * (1.0 + 1e-9)
        assert problem.violation(answers[0].thrusts) < 1e-12


@pytest.mark.parametrize('name', PROBLEMS)
def test_c_equals_numpy(name):
    """With the same wrenches, least costs, levels and ends of lines, inside and beyond."""
    problem, rng = PROBLEMS[name], seeded(8)
    solvers = [SetsNewton(problem.gamma, problem.sets), problem.program.least_norm]
    if solvers[1].engine != 'C':
        pytest.skip('the extension module is not built')
    low, high = 1.3 * problem.lower, 1.3 * problem.upper
    wrenches = problem.clip(rng.uniform(low, high, (WRENCHES, problem.n))) @ problem.gamma.T
    found = [solver.solve(wrenches) for solver in solvers]
    size = np.maximum(1.0, np.linalg.norm(wrenches, axis=1))
    for each in found:
        assert each.attained.all()
        missed = np.linalg.norm(wrenches - each.points @ problem.gamma.T, axis=1)
        assert (missed <= 1e-12 * size).all()
    costs = [(each.points**2).sum(axis=1) for each in found]
    assert (np.abs(costs[0] - costs[1]) <= 1e-9 * np.maximum(1.0, costs[0])).all()
    begin = AdmissibleSet(problem).reference
    for _ in range(BEYOND_SETS):
        way = 3.0 * problem.extent * rng.normal(size=len(begin))
        first, second = (solver.line(begin, way) for solver in solvers)
        assert first.length == pytest.approx(second.length, abs=1e-9)
        for line in (first, second):
            assert -1e-10 < line.most - line.length < 1e-9
            height = problem.sets.support(line.normal @ problem.gamma)
            assert line.most == pytest.approx((height - line.normal @ begin) / (line.normal @ way))
            np.testing.assert_allclose(problem.clip(line.point), line.point, atol=2e-15)


@pytest.mark.parametrize('policy', ['prioritize', 'scale', 'reject'])
@pytest.mark.parametrize('name', ['hexarotor_tilting', 'azimuth_boat'])
def test_allocators_in_c_and_numpy_agree(name, policy, monkeypatch):
    problem, rng = PROBLEMS[name], seeded(9)
    wrenches = problem.center + problem.extent * rng.normal(size=(6, len(problem.axes)))
    wrenches[0] = problem.reference
    in_c = make_allocator('exact', problem, policy=policy)
    monkeypatch.setenv('CA_ROS_KERNEL', 'numpy')
    # A problem keeps its solver.
    again = VehicleProblem(problem.vehicle)
    plain = make_allocator('exact', again, policy=policy)
    assert (in_c.engine, plain.engine) == ('C', 'NumPy')
    first, second = in_c.allocate_batch(wrenches), plain.allocate_batch(wrenches)
    np.testing.assert_array_equal(first.status, second.status)
    np.testing.assert_allclose(first.level, second.level, atol=1e-6)
    np.testing.assert_allclose(first.wrench, second.wrench, atol=1e-6)
    for u, level, vectors in zip(wrenches, first.level, first.thrusts, strict=True):
        one = in_c.allocate(u)
        assert one.level == level
        np.testing.assert_array_equal(one.thrusts, vectors)


def test_the_kernel_refuses_tilts():
    problem = PROBLEMS['tricopter']
    with pytest.raises(TypeError, match='vectors in sets, not numbers within bounds'):
        kernel_for(object, problem, ExactSettings())


BOAT = """problem:
  axes: [surge, sway, yaw]
  effector_names: [left, right, bow]
  effector_unit: N
  matrix: [[1.0, 0.0, 1.0, 0.0, 0.0],
           [0.0, 1.0, 0.0, 1.0, 1.0],
           [-0.5, -1.0, 0.5, -1.0, 1.5]]
  sets: [{disc: 2.0}, {sector: 0.5, radius: 4.0}, {interval: [-1.0, 1.0]}]
"""


def test_sets_in_the_file_of_a_problem(tmp_path):
    file = tmp_path / 'boat.yaml'
    file.write_text(BOAT)
    problem = AllocationProblem.load(file)
    assert problem.effector_names == ('left.1', 'left.2', 'right.1', 'right.2', 'bow')
    assert problem.unit == ' N'
    answer = make_allocator('exact', problem).allocate([3.0, 0.5, 0.2])
    assert answer.status.name == 'EXACT'
    assert np.abs(problem.gamma @ answer.thrusts - [3.0, 0.5, 0.2]).max() < 1e-12
    assert np.hypot(*answer.thrusts[:2]) <= 2.0
    assert abs(np.arctan2(*answer.thrusts[[3, 2]])) <= 0.5
    for wrong, words in (
        ('{square: 2.0}, ', r'problem\.sets\[0\]: expected one of interval, sector, cone, disc'),
        ('{disc: 2.0, radius: 1.0}, ', r'problem\.sets\[0\]: expected one of'),
        ('{sector: 0.2}, ', r'with the radius of a sector or cone, got'),
        ('{sector: 2.0, radius: 1.0}, ', r'problem\.sets\[0\]: half_angle: expected up to pi/2'),
    ):
        file.write_text(BOAT.replace('{disc: 2.0}, ', wrong))
        with pytest.raises(ParameterError, match=words):
            AllocationProblem.load(file)
    file.write_text(BOAT + '  lower: 0.0\n')
    with pytest.raises(ParameterError, match=r'problem\.lower: given beside sets'):
        AllocationProblem.load(file)


@pytest.mark.parametrize('newton', [sets_newton, SetsNewton])
@pytest.mark.parametrize('seed', range(length(20, 200)))
def test_preferred_vectors_whose_squares_overflow_end_at_the_tip_of_the_set(newton, seed):
    rng = seeded(seed)
    size, radius = int(rng.integers(2, 4)), rng.uniform(1.0, 5.0)
    sets = ConvexSets([Sector(rng.choice([rng.uniform(0.1, 1.5), np.pi]), radius, size)])
    tip, far = np.zeros((2, size))
    tip[0], far[0] = radius, 10.0 ** rng.uniform(154.0, 165.0)
    solver = newton(np.eye(size)[1:2], sets, np.ones(size), far)
    found = solver.solve(np.zeros((1, 1)))
    assert found.attained[0]
    np.testing.assert_allclose(found.points[0], tip, rtol=1e-12)
