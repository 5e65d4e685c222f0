// A vehicle from its settings, with the bits of ca_ros.vehicle: the control allocation matrix and the bounds.
import {check, FIELDS, readSettings} from './settings.js';

export const AXES = FIELDS['allocation.axes'].choices;
const ACCELERATION = 2000; // of rotors without a rate in the file [rad/s^2]
const HEALTH_MIN = 1e-9, ROTORS_MAX = 32, SEGMENTS_MAX = 64, APART_MAX = 2, WEIGHTS_MAX = 1e4, PREFERRED_MAX = 100;

function expect(sound, name, expected) {
  if (!sound) throw new Error(`${name}: expected ${expected}`);
}

/** Return x, y and z of each of a flat list. */
function triples(name, value) {
  const list = [value].flat();
  expect(list.length && list.length % 3 === 0, name, `x, y, z per rotor, got ${list.length} numbers`);
  return Array.from({length: list.length / 3}, (_, i) => list.slice(3 * i, 3 * i + 3));
}

function positions(get) {
  const [count, radius, angle, height] = ['count', 'radius', 'first_angle', 'height'].map((name) => get(`rotors.ring.${name}`));
  const given = get('rotors.positions') !== 0;
  expect(!(given && count), 'rotors.positions', 'either positions or rotors.ring, got both');
  expect(given || count, 'rotors.positions', 'x, y, z of each rotor [m], or rotors.ring');
  expect(count || !(radius || angle || height), 'rotors.ring.count', 'the number of rotors on the ring');
  expect(!count || radius, 'rotors.ring.radius', 'the radius of the ring [m]');
  expect(count <= ROTORS_MAX, 'rotors.positions', `up to ${ROTORS_MAX} rotors, got ${count}`);
  return count ? ring(count, radius, angle, height) : triples('rotors.positions', get('rotors.positions'));
}

function ring(count, radius, firstAngle, height) {
  const [top, bottom] = fraction(firstAngle);
  return Array.from({length: count}, (_, i) => {
    // An angle in turns, as a fraction; mirrored angles give the same digits.
    const below = bottom * 360n * BigInt(count);
    const above = top * BigInt(count) + BigInt(i) * bottom * 360n;
    const quarters = roundHalfEven(4n * above, below);
    const rest = above * 4n - quarters * below, size = rest < 0n ? -rest : rest;
    const angle = 2 * Math.PI * ratio(size, 4n * below);
    const c = Math.cos(angle);
    let s = 3n * size === below ? 0.5 : 2n * size === below ? c : Math.sin(angle);
    if (rest < 0n) s = -s;
    const turn = [[c, s], [-s, c], [-c, -s], [s, -c]][Number(((quarters % 4n) + 4n) % 4n)];
    return [radius * turn[0] + 0, radius * turn[1] + 0, height + 0];
  });
}

function fraction(x) {
  let bottom = 1n;
  while (x % 1) [x, bottom] = [2 * x, 2n * bottom];
  return [BigInt(x), bottom];
}

/** The quotient of two whole numbers, rounded once. */
function ratio(above, below) {
  const scaled = (above << 200n) / below;
  return Number(scaled) / 2 ** 200;
}

function roundHalfEven(above, below) {
  const floor = (above - (((above % below) + below) % below)) / below, twice = 2n * (above - floor * below);
  return twice > below || (twice === below && floor % 2n) ? floor + 1n : floor;
}

/** Return two rises and two falls, as ca_ros.problem.prioritization.airmode_limits. */
export function airmodeLimits(name, given) {
  const [first, second = first, ...falls] = [given].flat(), limits = [first, second, ...(falls.length ? falls : [1, 1])];
  expect(limits[1] <= limits[0] && limits[3] <= limits[2], name, `limits for yaw up to those for roll and pitch, got ${[given]}`);
  return limits;
}

/** Return the groups of an order, words of axes, without the axes that are not commanded. */
export function groups(name, order, axes) {
  const listed = [order].flat().map((group) => group.split(/\s+/).filter(Boolean)), flat = listed.flat();
  const sound = new Set(flat).size === flat.length && listed.every((group) => group.length) &&
    axes.every((axis) => flat.includes(axis)) && flat.every((axis) => AXES.includes(axis));
  expect(sound, name, `groups that name each of ${axes.join(', ')} once, got ${order}`);
  return listed.map((group) => group.filter((axis) => axes.includes(axis)).join(' ')).filter(Boolean);
}

/** Return a vehicle: what the kernel and the picture need, and `exact`, which a case can change. */
export function readVehicle(text) {
  const [get, given] = readSettings(text);
  const some = (name) => [get(`rotors.${name}`)].flat().some((x) => x !== 0);
  for (const name of ['tilt_axes', 'gimbal']) expect(!some(name), `rotors.${name}`, 'fixed rotors: the explorer knows no others');
  const places = positions(get), n = places.length;
  expect(n <= ROTORS_MAX, 'rotors.positions', `up to ${ROTORS_MAX} rotors, got ${n}`);
  const com = get('vehicle.center_of_mass'), arms = places.map((place) => place.map((x, i) => x - com[i]));
  let directions = triples('rotors.axes', get('rotors.axes')).map(([x, y, z]) => {
    const length = Math.sqrt(x * x + y * y + z * z);
    expect(length > 0, 'rotors.axes', 'axes longer than zero');
    return [x / length, y / length, z / length];
  });
  if (directions.length === 1) directions = Array(n).fill(directions[0]);
  expect(directions.length === n, 'rotors.axes', `3 or ${3 * n} numbers`);
  const words = get('rotors.spins');
  expect(Array.isArray(words) && words.length === n, 'rotors.spins', `${n} words, one per rotor, got ${words}`);
  const spins = words.map((word) => (word === 'cw' ? 1 : -1));
  const each = (name) => {
    const list = [get(name)].flat();
    expect(list.length === 1 || list.length === n, name, `1 or ${n} numbers, one per rotor, got ${list.length}`);
    return list.length === 1 ? Array(n).fill(list[0]) : list;
  };
  const forward = each('rotors.thrust_coefficient'), torque = each('rotors.torque_coefficient');
  const reverse = each('rotors.thrust_coefficient_reverse').map((k, i) => (k > 0 ? k : forward[i]));
  const [rates, slowing] = ['rotors.acceleration_max', 'rotors.deceleration_max'].map(each);
  expect(rates.every((a) => a > 0) || (rates.every((a) => a === 0) && slowing.every((d) => d === 0)),
    'rotors.acceleration_max', 'positive numbers for all rotors, or 0 for all');
  expect(slowing.every((d) => d > 0) || slowing.every((d) => d === 0), 'rotors.deceleration_max', 'positive numbers for all rotors, or 0 for all');
  const acceleration = rates.map((a) => a || ACCELERATION);

  const low = each('rotors.speed_min'), high = each('rotors.speed_max');
  low.forEach((speed, i) => expect(speed <= high[i], 'rotors.speed_min', `up to rotors.speed_max, got ${speed} of rotor ${i + 1}`));
  const perVolt = each('rotors.speed_max_per_volt'), volts = get('rotors.battery_voltage');
  const nominal = volts || Math.max(0, ...perVolt.map((k, i) => (k ? high[i] / k : 0)));
  const throttle = Math.max(...high, ...perVolt.map((k) => 1.5 * nominal * k)); // a full battery
  const curve = thrustCurve(get, forward, low, high, throttle);
  const full = perVolt.map((k) => (volts && k ? k * volts : Infinity)); // the battery limits the speeds
  const speedMin = low.map((s, i) => Math.max(s, -full[i])), speedMax = high.map((s, i) => Math.min(s, full[i]));
  expect(!volts || speedMax.every((s, i) => s > Math.max(speedMin[i], 0)), 'rotors.battery_voltage', 'enough to turn the rotors');

  const wanted = [get('allocation.axes')].flat(), axes = AXES.filter((axis) => wanted.includes(axis));
  expect(axes.length && axes.length === wanted.length, 'allocation.axes', `different axes, got ${wanted}`);
  expect(axes.length > 1, 'allocation.axes', 'two axes or more to draw, got one');
  const weight = get('vehicle.mass') * get('vehicle.gravity') - get('vehicle.buoyancy');
  const wrenches = arms.map(([x, y, z], i) => {
    const [a, b, c] = directions[i], k = spins[i] * (torque[i] / forward[i]);
    return [a, b, c, k * a + (y * c - z * b), k * b + (z * a - x * c), k * c + (x * b - y * a)];
  });
  const vehicle = {
    name: get('vehicle.name'), n, axes, arms, directions, spins, curve, forward, reverse, speedMin, speedMax, acceleration,
    gamma: axes.map((axis) => wrenches.map((wrench) => wrench[AXES.indexOf(axis)])),
    reference: axes.map((axis) => (axis === 'thrust' ? weight : 0)),
    deceleration: slowing.map((d, i) => d || acceleration[i]),
    weight: each('allocation.exact.weights'), preferred: each('allocation.exact.preferred'),
    slack: get('allocation.exact.residual_slack'),
    health: each('rotors.health'), policy: get('allocation.exact.policy'), deviation: get('allocation.exact.thrust_deviation'),
    airmode: airmodeLimits('allocation.exact.airmode_limit', get('allocation.exact.airmode_limit')),
    order: groups('allocation.exact.order', get('allocation.exact.order'), axes),
    source: JSON.stringify({'/**': {ros__parameters: given}}), // what a link has to carry, as YAML
  };
  expect(Math.max(...vehicle.weight) <= WEIGHTS_MAX * Math.min(...vehicle.weight), 'allocation.exact.weights', 'weights up to 1e4 times each other');
  const {lower, upper} = bounds(vehicle, vehicle.health), most = PREFERRED_MAX * Math.max(1, ...[...lower, ...upper].map(Math.abs));
  expect(vehicle.preferred.every((f) => Math.abs(f) <= most), 'allocation.exact.preferred', `thrusts up to ${most}`);
  return vehicle;
}

/** Return the segments of a measured thrust curve, as ca_ros.vehicle.thrust_curve; none: k_f w^2. */
function thrustCurve(get, forward, low, high, throttle) {
  const group = 'rotors.thrust_curve', [polynomial, speeds, thrusts, throttles] =
    ['polynomial', 'speeds', 'thrusts', 'throttles'].map((name) => get(`${group}.${name}`));
  const pieces = [], least = Math.min(...low), top = Math.max(...high);
  expect(polynomial === 0 || thrusts === 0, `${group}.polynomial`, 'either the polynomial or thrusts, got both');
  expect((thrusts === 0 && throttles === 0) || speeds !== 0, `${group}.speeds`, 'the speeds of thrusts and throttles [rad/s]');
  for (const [name, list] of Object.entries({speeds, thrusts, throttles})) {
    const rises = Array.isArray(list) && list.length > 1 && list[0] >= 0 && list.every((x, i) => !i || x > list[i - 1]);
    expect(list === 0 || rises, `${group}.${name}`, 'two or more numbers from 0 on that increase');
    expect(list === 0 || list.length === speeds.length, `${group}.${name}`, 'one for each of the speeds');
  }
  expect(speeds === 0 || speeds.at(-1) >= top * (1 - 1e-9), `${group}.speeds`, `speeds up to speed_max, ${top}`);
  const pwm = get(`${group}.pwm`);
  expect(pwm[0] !== pwm[1], `${group}.pwm`, 'two different pulse widths');
  if (polynomial === 0 && thrusts === 0) return [];
  expect(least >= 0 && forward.every((k) => k === forward[0]), group, 'rotors with one thrust_coefficient that do not reverse');
  if (polynomial !== 0) {
    expect(polynomial.length === 3, `${group}.polynomial`, 'a, b and c');
    const [a, b, c] = polynomial, at = (a * least + b) * least + c, end = throttles === 0 ? throttle : top;
    const rises = Math.min(2 * a * least + b, 2 * a * end + b) >= 0 && (a || b);
    expect(rises && (least > 0 ? at > 0 : c === 0), `${group}.polynomial`, 'thrusts that are positive and increase from speed_min to full throttle');
    if (least > 0) pieces.push([0, at / (least * least), 0, 0]);
    pieces.push([Math.max(least, 0), a, b, c]);
  } else {
    const w = [...speeds], f = [...thrusts];
    expect((w[0] === 0) === (f[0] === 0), `${group}.thrusts`, '0 N only at rest');
    if (w[0] > 0) [w, f].forEach((list) => list.unshift(0));
    w.slice(1).forEach((x, i) => {
      const a = (f[i + 1] - f[i]) / (x * x - w[i] * w[i]);
      pieces.push([w[i], a, 0, f[i] - a * (w[i] * w[i])]);
    });
  }
  expect(pieces.length <= SEGMENTS_MAX, group, `up to ${SEGMENTS_MAX} points`);
  const curve = pieces.map(([start, a, b, c]) => ({start, abc: [a, b, c], level: (a * start + b) * start + c}));
  const apart = thrustAt(curve, top) / (forward[0] * top * top);
  expect(apart >= 1 / APART_MAX && apart <= APART_MAX, group, 'thrusts in the unit of thrust_coefficient');
  return curve;
}

function thrustAt(curve, speed) {
  const [a, b, c] = curve.findLast(({start}) => start <= speed).abc;
  return (a * speed + b) * speed + c;
}

/** Return bounds of thrusts and speeds of rotors with some health. */
export function bounds(vehicle, health) {
  const share = health.map((h) => (h < HEALTH_MIN ? 0 : h));
  const {curve, forward, reverse, speedMin, speedMax} = vehicle;
  const thrust = (speed, i) => {
    if (curve.length) return share[i] * forward[i] / forward[0] * thrustAt(curve, speed);
    return speed < 0 ? -(share[i] * reverse[i] * (speed * speed)) : share[i] * forward[i] * (speed * speed);
  };
  const turning = (speeds) => speeds.map((speed, i) => speed * (share[i] * forward[i] > 0 ? 1 : 0));
  const factor = (coefficients) => coefficients.map((k, i) => (share[i] * k > 0 ? share[i] * k : 1));
  return {
    lower: speedMin.map(thrust), upper: speedMax.map(thrust), speedMin: turning(speedMin), speedMax: turning(speedMax),
    forward: factor(forward), reverse: factor(reverse),
  };
}

/** Return what a case sets beside the vehicle, checked: all of it, from what is given. */
export function readCase(vehicle, given, methods) {
  const {axes, n} = vehicle, exact = (name) => FIELDS[`allocation.exact.${name}`];
  const fields = {
    demand: {...FIELDS['vehicle.center_of_mass'], sizes: [axes.length]},
    health: {...FIELDS['rotors.health'], sizes: [n]},
    policy: exact('policy'), order: exact('order'), deviation: exact('thrust_deviation'), airmode: exact('airmode_limit'),
    elapsed: {...FIELDS['vehicle.buoyancy'], range: 'a time in seconds, at least 0'},
    beside: {words: true, choices: methods, range: `one of ${methods.filter(Boolean).join(', ')}`},
    shown: {words: true, array: true, sizes: [2, 3], choices: axes, range: `of ${axes.join(', ')}`},
  };
  const {health, policy, order, deviation, airmode, reference} = vehicle;
  const state = {demand: reference, health, policy, order, deviation, airmode, elapsed: 0, beside: '', shown: axes.slice(-3)};
  for (const [name, value] of Object.entries(given)) {
    if (!Object.hasOwn(fields, name)) throw new Error(`${name}: no such parameter`);
    state[name] = check(name, value, fields[name]);
  }
  state.order = groups('order', state.order, axes);
  state.airmode = airmodeLimits('airmode', state.airmode);
  expect(new Set(state.shown).size === state.shown.length, 'shown', `different axes, got ${state.shown}`);
  return state;
}
