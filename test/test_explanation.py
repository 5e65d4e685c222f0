"""Why: the shares served and the bounds that limit them, against linear programs solved again."""

from functools import partial

import numpy as np
import pytest

from ca_ros import AdmissibleSet, SlewLimited, Status, Vehicle, make_allocator
from ca_ros.allocation.box_backend import kernel_for
from ca_ros.allocation.exact_settings import ExactSettings
from ca_ros.kernel import load
from ca_ros.problem.limits import ALONE, BY_BOUND, BY_HEALTH, BY_RATE, TOGETHER, Limits
from ca_ros.problem.prioritization import airmode_limits
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.vehicle.files import shipped_vehicles
from strategies import FLEET, HEXAROTOR, SOME, extreme, length, need_kernel, seeded, unaudited
from test_prioritize import LOST, ORDERS, Judge, groups_of

LIMITS = [1.0, 0.0, [0.3, 0.1]]


@pytest.mark.parametrize('name', SOME)
def test_both_engines_name_the_same(name, monkeypatch):
    need_kernel()
    problem = VehicleProblem(FLEET[name])
    rng = seeded(3)
    demands = problem.center + rng.uniform(-2.0, 2.0, (length(10, 60), problem.gamma.shape[0])) \
        * problem.extent
    for limit in LIMITS:
        made = []
        for engine in ('c', 'numpy'):
            monkeypatch.setenv('CA_ROS_KERNEL', engine)
            made.append(make_allocator('exact', problem, airmode_limit=limit))
        for u in demands:
            ours, theirs = (allocator.allocate(u).explanation for allocator in made)
            np.testing.assert_allclose(ours.served, theirs.served, atol=1e-8)
            assert ours.margin == pytest.approx(theirs.margin, abs=1e-9)
            np.testing.assert_array_equal(ours.limit, theirs.limit)
            np.testing.assert_array_equal(ours.blocks, theirs.blocks)
            np.testing.assert_array_equal(ours.airmode_blocks, theirs.airmode_blocks)
            for gain in ('gain', 'joint_gain', 'airmode'):
                np.testing.assert_allclose(getattr(ours, gain), getattr(theirs, gain), atol=1e-4)
            assert str(ours) == str(theirs)


class Again(Judge):
    """The linear programs with other bounds, and all that follows from the bounds as it was."""

    def __init__(self, vehicle, begin, lower, upper, narrowed):
        super().__init__(vehicle)
        self.begin = begin
        self.low, self.high, self.narrowed = lower, upper, narrowed

    def rest(self, first, u):
        start = self.gamma[first] @ (self.low + self.high) / 2.0
        return start if self.narrowed else self.begin

    def line(self, first, u):
        begin, way = self.begin, u[first] - self.begin
        if self.narrowed:
            # As near to the line as possible first.
            start = self.rest(first, u)
            back = begin - start
            begin = start + min(1.0, self.along(first, start, back, way)) * back
        return begin, way


class Case:
    """A vehicle with priorities, whose answers the linear programs explain as well."""

    def __init__(self, vehicle, order='default', airmode=1.0, rates=None, deviation='prevent'):
        self.vehicle, self.deviation = vehicle, deviation
        lateral = [[axis for axis in vehicle.axes if axis.startswith('force')]]
        named = ORDERS[order] + lateral * bool(lateral[0])
        self.groups = groups_of(vehicle, named)
        self.exact = unaudited('exact', vehicle, order=named, airmode_limit=airmode,
                               axis_reversal=deviation)
        self.problem, self.airmode = self.exact.problem, airmode_limits(airmode)
        self.slow = None if rates is None else SlewLimited(self.exact, rates)
        judge, first = Judge(vehicle), self.groups[0]
        self.begin = judge.line(first, judge.hover)[0] if len(first) > 1 else None
        rest = judge.serve(judge.hover, self.groups, 'allow')
        self.lost = np.flatnonzero(rest[:, 1] - judge.hover > LOST * judge.half)

    def answers(self, rng, size):
        """Yield answers to random demands, many of them at hover but for some axes."""
        problem, speeds = self.problem, np.array(self.vehicle.speed_limits)
        for _ in range(size):
            u = problem.center + rng.uniform(-1.5, 1.5, len(problem.axes)) * problem.extent
            u = np.where(rng.random(len(u)) < 0.3, problem.reference, u)
            if self.slow is None:
                yield self.exact.allocate(u)
            else:
                yield self.slow.allocate(u, rng.uniform(*speeds), rng.uniform(0.005, 0.05))

    def missed(self, answer, moves=(), distance=0.0):
        """Return the errors (m,) if the demand is served again with some bounds moved out."""
        lower, upper = map(np.array, answer.bounds or (self.problem.lower, self.problem.upper))
        airmode = np.array(self.airmode)
        for rotor, side in moves:
            if side > 0:
                upper[rotor] += distance
            elif side < 0:
                lower[rotor] -= distance
            else:
                extent = self.problem.extent[self.problem.axes.index('thrust')]
                airmode[:2] += (airmode[:2] < 1.0) * distance / (2.0 * extent)
        narrowed = answer.bounds is not None
        judge = Again(self.vehicle, self.begin, lower, upper, narrowed)
        judge.serve(answer.demand, self.groups, self.deviation, self.lost, airmode)
        return np.abs(answer.demand - judge.gamma @ judge.thrusts)

    def reach(self, answer, moves):
        """Return the distance within which a gain holds [N]."""
        lower, upper = answer.bounds or (self.problem.lower, self.problem.upper)
        half, longest = self.problem.half_range, self.problem.half_range.max()
        reaches = [
            self.problem.extent[self.problem.axes.index('thrust')] if side == 0
            else max((upper - lower)[i] / 2.0, 1e-3 * half[i]) if half[i] > 0.0 else longest
            for i, side in moves]
        return 1e-3 * min(reaches)


class ScaledCase(Case):
    """The same with the policy scale: one linear program."""

    def __init__(self, vehicle):
        super().__init__(vehicle)
        self.exact = unaudited('exact', vehicle, policy='scale')

    def missed(self, answer, moves=(), distance=0.0):
        lower, upper = self.problem.lower.copy(), self.problem.upper.copy()
        for rotor, side in moves:
            (upper if side > 0 else lower)[rotor] += side * distance
        start = AdmissibleSet(self.problem).reference
        way = answer.demand - start
        found = extreme(
            np.append(np.zeros(self.problem.n), -1.0), np.column_stack([self.problem.gamma, -way]),
            start, np.append(lower, 0.0), np.append(upper, 1.0))
        return (1.0 - found[-1]) * np.abs(way)


def check_statements(case, answer):
    """Check all that an explanation says by linear programs; return how much that is."""
    why, problem, checked = answer.explanation, case.problem, 0
    np.testing.assert_array_equal(
        why.served < 1.0, np.abs(answer.residual) > 1e-9 * problem.extent)
    assert why.margin == pytest.approx(float(answer.certificate.margin), abs=1e-9)
    rates = np.any(np.abs(why.limit) == BY_RATE)
    assert (answer.status is Status.RATE_LIMITED) == rates or answer.bounds is None
    if np.all(why.served == 1.0):
        return 0
    base, longest = case.missed(answer), problem.half_range.max()
    np.testing.assert_allclose(base, np.abs(answer.residual), atol=1e-5 * problem.extent.max())

    def gains(moves, share=1.0):
        distance = share * case.reach(answer, moves)
        return (base - case.missed(answer, moves, distance)) / distance

    sides = np.sign(why.limit)
    for k in np.flatnonzero(why.served < 1.0):
        # Gains below this may be rounding of the linear programs.
        least = 2e-3 * problem.extent[k] / longest
        blocking = [(i, sides[i]) for i in np.flatnonzero(why.blocks[k])]
        together = (why.blocks[k] == TOGETHER).any() or why.airmode_blocks[k] == TOGETHER
        named = [*blocking, *[(0, 0)] * bool(why.airmode_blocks[k])]
        stated = {**{(i, side): why.gain[k, i] for i, side in blocking}, (0, 0): why.airmode[k]}
        assert not together or not any(stated[each] for each in named)
        if not named:
            everything = [(i, side) for i in range(problem.n) for side in (-1, 1)]
            assert why.limits[problem.axes[k]] == 'axes that come first'
            # What is said is of small moves.  Gains are linear in pieces: a greater move may take
            # another rotor to its bound, and gain from there on.  None of 57 000 statements of
            # seven shipped vehicles needs the smaller one.
            assert gains(everything)[k] < least or gains(everything, 0.1)[k] < least
            checked += 1
        for each in named:
            gain = gains([each])[k]
            if together:
                assert gain < least, (k, each)
            else:
                assert gain > 0.0, (k, each)
                if stated[each]:
                    assert gain == pytest.approx(stated[each], rel=1e-2, abs=least), (k, each)
            checked += 1
        if together:
            assert len(named) > 1
            gain = gains(named)[k]
            assert gain > 0.0
            if why.joint_gain[k]:
                assert gain == pytest.approx(why.joint_gain[k], rel=1e-2, abs=least)
            checked += 1
    return checked


LOST_ROTOR = {name: Vehicle.with_health(FLEET[name], health) for name, health in (
    ('hexarotor', [0.0, 1.0, 1.0, 0.5, 1.0, 1.0]), ('octorotor', [1.0] * 7 + [0.0]))}
CASES = {
    'quadrotor': lambda: Case(FLEET['quadrotor']),
    'hexarotor': lambda: Case(HEXAROTOR),
    'x8': lambda: Case(FLEET['x8']),
    'asymmetric': lambda: Case(FLEET['asymmetric'], deviation='allow'),
    'tilted_hexarotor': lambda: Case(FLEET['tilted_hexarotor']),
    'hexarotor, one lost': lambda: Case(LOST_ROTOR['hexarotor']),
    'octorotor, one lost, thrust first': lambda: Case(LOST_ROTOR['octorotor'], 'thrust first'),
    'hexarotor, airmode': lambda: Case(HEXAROTOR, airmode=0.1),
    'asymmetric, airmode': lambda: Case(FLEET['asymmetric'], airmode=[0.5, 0.1]),
    'hexarotor_ppnnpn, rates': lambda: Case(FLEET['hexarotor_ppnnpn'], rates=2000.0),
    'quadrotor, rates': lambda: Case(FLEET['quadrotor'], 'one by one', rates=3000.0),
    'hexarotor, scale': lambda: ScaledCase(HEXAROTOR),
    'x8, rates and airmode': lambda: Case(FLEET['x8'], airmode=0.2, rates=2000.0),
}

KINDS = {'': {}, ', rates': {'rates': 2000.0}, ', airmode': {'airmode': [0.3, 0.1]},
         ', rates and airmode': {'rates': 2000.0, 'airmode': 0.2}}
CASES |= {f'shipped {name}{kind}': partial(Case, Vehicle.load(name), **options)
          for name in length([], shipped_vehicles()) for kind, options in KINDS.items()}


@pytest.mark.timeout(3600)
@pytest.mark.parametrize('name', CASES)
def test_what_is_said_is_so_when_the_demand_is_served_again(name):
    case, rng, checked = CASES[name](), seeded(1), 0
    for answer in case.answers(rng, 100000):
        try:
            checked += check_statements(case, answer)
        except AssertionError as error:
            raise AssertionError(f'{answer.demand.tolist()}, {answer.bounds}: {error}') from error
        if checked >= length(20, 1250):
            break


@pytest.mark.parametrize('name', SOME)
def test_in_single_precision_the_gains_are_the_same(name):
    need_kernel()
    problem, rng, count = VehicleProblem(FLEET[name]), seeded(2), 0
    m, n = problem.gamma.shape
    kernels = [kernel_for(load(precision), problem, ExactSettings(airmode_limit=0.1), dtype)
               for precision, dtype in (('double', np.float64), ('single', np.float32))]
    for _ in range(length(30, 3000)):
        u = problem.center + rng.uniform(-1.5, 1.5, m) * problem.extent
        found = []
        for kernel, dtype in zip(kernels, (np.float64, np.float32), strict=True):
            thrusts, numbers = np.empty(n, dtype), np.empty(m * (3 + n), dtype)
            names = np.empty((m + 1) * (1 + n), np.int32)
            kernel.allocate(u.astype(dtype), np.empty(m, dtype), thrusts)
            kernel.explain(u.astype(dtype), thrusts, numbers, names)
            found.append(Limits.of(numbers.reshape(m, -1), names.reshape(m + 1, -1)))
        double, single = found
        both = (double.gain > 0.0) & (single.gain > 0.0)
        # A bound moves by 1 and 3 % of its range, so that few other rotors reach theirs.
        np.testing.assert_allclose(single.gain[both], double.gain[both], rtol=0.05)
        assert np.sum((double.gain > 0.0) != (single.gain > 0.0)) <= 3 * m
        np.testing.assert_allclose(single.served, double.served, atol=1e-3)
        count += both.sum()
    assert count > 30


def test_a_rejected_demand_names_the_policy():
    reject = make_allocator('exact', HEXAROTOR, policy='reject')
    why = reject.allocate([99.0, 0.0, 0.0, 0.0]).explanation
    assert set(why.limits.values()) == {"the policy 'reject'"}
    assert why.margin < 0.0
    np.testing.assert_array_equal(why.blocks, 0)


def test_a_rotor_at_a_bound_that_limits_nothing_is_not_named():
    # By hand: yaw of 0.08 (f_P - f_N), all of a kind alike, is served in full with f_N = 0.04.
    exact = make_allocator('exact', HEXAROTOR)
    answer = exact.allocate([9.81, 0.0, 0.0, 0.03])
    assert answer.status is Status.EXACT
    np.testing.assert_array_equal(answer.explanation.limit, 0)
    np.testing.assert_array_equal(answer.explanation.served, 1.0)
    assert str(answer.explanation).startswith('all axes are served; margin')


def test_by_hand_and_in_words():
    # Yaw 0.06 (f_P - f_N) with f_P + f_N = 7 N: f_P = 4, f_N = 3, so 0.06 N m of 0.12.
    why = make_allocator('exact', HEXAROTOR, axis_reversal='allow').allocate(
        [21.0, 0.0, 0.0, 0.12]).explanation
    np.testing.assert_allclose(why.served, [1.0, 1.0, 1.0, 0.5], atol=1e-9)
    np.testing.assert_array_equal(why.limit, [BY_BOUND, 0] * 3)
    assert why.limits == {'yaw': 'rotors 1, 3, 5 at their maximum'}
    assert str(why) == 'yaw 50 % served, limited by rotors 1, 3, 5 at their maximum'


@pytest.mark.parametrize('engine', ['c', 'numpy'])
def test_where_all_rotors_are_at_a_bound_none_is_left_out(engine, monkeypatch):
    if engine == 'c':
        need_kernel()
    monkeypatch.setenv('CA_ROS_KERNEL', engine)
    for name in ('quadrotor', 'hexarotor', 'x8'):
        vehicle = Vehicle.load(name)
        rotors = ', '.join(str(i + 1) for i in range(vehicle.n))
        why = make_allocator('exact', vehicle).allocate([100.0, 0.0, 0.0, 0.0]).explanation
        assert why.limits == {'thrust': f'rotors {rotors} at their maximum, together'}
        np.testing.assert_array_equal(why.blocks[0], TOGETHER)
        np.testing.assert_array_equal(why.gain[0], 0.0)
        assert why.joint_gain[0] == pytest.approx(vehicle.n)


def test_a_lost_rotor_is_not_one_at_its_minimum():
    vehicle = Vehicle.load('hexarotor').with_health([0.0, 1.0, 1.0, 0.5, 1.0, 1.0])
    exact = make_allocator('exact', VehicleProblem(vehicle))
    # Rotor 1 is forward: it would lift the nose.
    answer = exact.allocate([12.0, 0.0, -4.0, 0.0])
    why = answer.explanation
    assert why.served[2] < 1.0
    assert why.limit[0] == BY_HEALTH
    assert 'rotor 1 which is lost' in why.limits['pitch']
    assert 'rotor 4 by its health' in exact.allocate(
        [12.0, 0.0, 4.0, 0.0]).explanation.limits['pitch']


def test_a_limit_on_airmode_is_named():
    why = make_allocator('exact', HEXAROTOR, airmode_limit=0.1).allocate(
        [0.1, 1.5, 0.0, 0.0]).explanation
    assert why.airmode[1] > 0.0
    assert why.limits['roll'].endswith(' and the limit on airmode')
    assert why.airmode_blocks[1] == ALONE


@pytest.mark.parametrize('method', ['pseudo_inverse', 'direct', 'sequential_desaturation'])
def test_other_methods_are_explained_too(method):
    allocator = make_allocator(method, HEXAROTOR)
    why = allocator.allocate([9.81, 3.0, 0.0, 0.0]).explanation
    assert why.margin < 0.0
    assert why.served[1] < 1.0
    assert 'rotor' in why.limits['roll']
    inside = allocator.allocate([9.81, 0.0, 0.0, 0.0]).explanation
    assert inside.limits == {}
