// A vehicle from its YAML, with the bits of ca_ros.vehicle: the control allocation matrix and the bounds.
import {load} from 'js-yaml';

export const AXES = ['force_x', 'force_y', 'thrust', 'roll', 'pitch', 'yaw'];
const ORDER = ['roll pitch', 'thrust', 'yaw', 'force_x force_y'];
const ACCELERATION = 2000; // of rotors without a rate in the file [rad/s^2]
const HEALTH_MIN = 1e-9, ROTORS_MAX = 32, SEGMENTS_MAX = 64;

/** Return the parameters that the allocator reads in a ROS parameter file, nested. */
export function readParameters(text) {
  let content;
  try {
    content = load(text);
  } catch (error) {
    throw new Error(`not readable YAML: ${String(error.message).split('\n')[0]}`);
  }
  if (content?.problem) throw new Error('a problem without a vehicle, which has no rotors to show');
  const merged = {};
  const visit = (tree, name) => {
    for (const [key, below] of Object.entries(tree)) {
      if (key === 'ros__parameters' && /(\*|^allocator)$/.test(name)) merge(merged, below);
      else if (isMap(below)) visit(below, key.split('/').at(-1));
    }
  };
  if (isMap(content)) visit(content, '');
  if (!isMap(merged.vehicle) || !isMap(merged.rotors)) {
    throw new Error("expected a ROS parameter file: '/**:', 'ros__parameters:', 'vehicle:' and 'rotors:'");
  }
  return merged;
}

const isMap = (value) => value !== null && typeof value === 'object' && !Array.isArray(value);

function merge(into, tree) {
  for (const [path, value] of Object.entries(tree ?? {})) {
    const [key, ...rest] = path.split('.');
    const found = rest.length ? {[rest.join('.')]: value} : value;
    if (isMap(found)) merge((into[key] = isMap(into[key]) ? into[key] : {}), found);
    else into[key] = found;
  }
}

/** Return numbers of a group, checked: an array, or `n` equal ones for a single number. */
function numbers(tree, name, n, missing) {
  const key = name.split('.').at(-1);
  const value = tree?.[key] ?? missing;
  if (value === undefined) throw new Error(`${name}: missing`);
  const list = [value].flat();
  for (const entry of list) {
    if (typeof entry !== 'number' || !Number.isFinite(entry)) {
      throw new Error(`${name}: expected finite numbers, got ${JSON.stringify(entry)}`);
    }
  }
  if (n && list.length !== 1 && list.length !== n) {
    throw new Error(`${name}: expected 1 or ${n} numbers, got ${list.length}`);
  }
  return n && list.length === 1 ? Array(n).fill(list[0]) : list;
}

const triples = (list, name) => {
  if (!list.length || list.length % 3) throw new Error(`${name}: expected x, y, z per rotor, got ${list.length} numbers`);
  return Array.from({length: list.length / 3}, (_, i) => list.slice(3 * i, 3 * i + 3));
};

function ring({count, radius, first_angle = 0, height = 0}) {
  const [top, bottom] = fraction(first_angle);
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
const airmode = ([first, second = first, ...falls]) => [first, second, ...(falls.length ? falls : [1, 1])];

/** Return a vehicle: what the kernel and the picture need. */
export function readVehicle(text) {
  const tree = readParameters(text);
  const {vehicle: body, rotors, allocation = {}} = tree;
  if (rotors.tilt_axes) throw new Error('rotors.tilt_axes: the explorer knows fixed rotors only');
  const zero = [0, 0, 0];
  const places = rotors.ring?.count ? ring(rotors.ring) : triples(numbers(rotors, 'rotors.positions'), 'rotors.positions');
  const n = places.length;
  if (n > ROTORS_MAX) throw new Error(`rotors.positions: expected up to ${ROTORS_MAX} rotors, got ${n}`);
  const com = numbers(body, 'vehicle.center_of_mass', 0, zero);
  const arms = places.map((place) => place.map((x, i) => x - com[i]));
  let directions = triples(numbers(rotors, 'rotors.axes', 0, [0, 0, 1]), 'rotors.axes').map(([x, y, z]) => {
    const length = Math.sqrt(x * x + y * y + z * z);
    if (!(length > 0)) throw new Error('rotors.axes: an axis has length zero');
    return [x / length, y / length, z / length];
  });
  if (directions.length === 1) directions = Array(n).fill(directions[0]);
  if (directions.length !== n) throw new Error(`rotors.axes: expected 3 or ${3 * n} numbers for ${n} rotors`);
  const words = rotors.spins;
  if (!Array.isArray(words) || words.length !== n || words.some((word) => word !== 'cw' && word !== 'ccw')) {
    throw new Error(`rotors.spins: expected ${n} words, cw or ccw, one per rotor`);
  }
  const spins = words.map((word) => (word === 'cw' ? 1 : -1));
  const each = (name, missing) => numbers(rotors, `rotors.${name}`, n, missing);
  const forward = each('thrust_coefficient');
  const reverse = each('thrust_coefficient_reverse', 0).map((k, i) => (k > 0 ? k : forward[i]));
  const torque = each('torque_coefficient');
  // The battery limits the speeds.
  const volts = rotors.battery_voltage || 0, perVolt = each('speed_max_per_volt', 0);
  const full = perVolt.map((k) => (volts && k ? k * volts : Infinity));
  const speedMin = each('speed_min').map((s, i) => Math.max(s, -full[i])), speedMax = each('speed_max').map((s, i) => Math.min(s, full[i]));
  const curve = thrustCurve(rotors.thrust_curve ?? {}, each('speed_min'), each('speed_max'));
  if (curve.length && (speedMin.some((s) => s < 0) || forward.some((k) => k !== forward[0]))) {
    throw new Error('rotors.thrust_curve: expected rotors with one thrust_coefficient that do not reverse');
  }
  for (let i = 0; i < n; i++) {
    if (!(forward[i] > 0)) throw new Error('rotors.thrust_coefficient: expected positive numbers');
    if (speedMin[i] > speedMax[i]) {
      throw new Error(`rotors.speed_min: ${speedMin[i]} rad/s of rotor ${i + 1} is above its rotors.speed_max`);
    }
  }
  const wanted = allocation.axes ?? ['thrust', 'roll', 'pitch', 'yaw'];
  const axes = AXES.filter((axis) => wanted.includes(axis));
  const [mass] = numbers(body, 'vehicle.mass'), [gravity] = numbers(body, 'vehicle.gravity', 1, 9.81);
  const weight = mass * gravity - numbers(body, 'vehicle.buoyancy', 1, 0)[0];
  const wrenches = arms.map(([x, y, z], i) => {
    const [a, b, c] = directions[i], k = spins[i] * (torque[i] / forward[i]);
    return [a, b, c, k * a + (y * c - z * b), k * b + (z * a - x * c), k * c + (x * b - y * a)];
  });
  const exact = allocation.exact ?? {};
  return {
    name: String(body.name ?? 'multirotor'), n, axes, arms, directions, spins, curve, forward, reverse, speedMin, speedMax,
    gamma: axes.map((axis) => wrenches.map((wrench) => wrench[AXES.indexOf(axis)])),
    reference: axes.map((axis) => (axis === 'thrust' ? weight : 0)),
    health: each('health', 1),
    weight: numbers(exact, 'allocation.exact.weights', n, 1),
    acceleration: each('acceleration_max', 0).map((a) => a || ACCELERATION),
    deceleration: each('deceleration_max', 0).map((d, i) => d || each('acceleration_max', 0)[i] || ACCELERATION),
    airmode: airmode(numbers(exact, 'allocation.exact.airmode_limit', 0, 1)),
    preferred: numbers(exact, 'allocation.exact.preferred', n, 0),
    slack: numbers(exact, 'allocation.exact.residual_slack', 1, 1e-9)[0],
    policy: exact.policy ?? 'prioritize', deviation: exact.thrust_deviation ?? 'prevent',
    order: (exact.order ?? ORDER).map((group) => group.split(' ').filter((axis) => axes.includes(axis)))
      .filter((group) => group.length),
    // What a link has to carry, as YAML.
    source: JSON.stringify({'/**': {ros__parameters: {vehicle: body, rotors, allocation}}}),
  };
}

/** Return the segments of a measured thrust curve, as ca_ros.vehicle.thrust_curve; none: k_f w^2. */
function thrustCurve(given, low, high) {
  const group = 'rotors.thrust_curve', pieces = [];
  if (given.polynomial) {
    const [a, b, c] = numbers(given, `${group}.polynomial`, 3), least = Math.min(...low), at = (a * least + b) * least + c;
    if (!(least > 0 ? at > 0 : c === 0) || Math.min(2 * a * least + b, 2 * a * Math.max(...high) + b) < 0) {
      throw new Error(`${group}.polynomial: expected thrusts that are positive and increase from speed_min to speed_max`);
    }
    if (least > 0) pieces.push([0, at / (least * least), 0, 0]);
    pieces.push([Math.max(least, 0), a, b, c]);
  } else if (given.thrusts) {
    const w = numbers(given, `${group}.speeds`), f = numbers(given, `${group}.thrusts`);
    if (w.length !== f.length || w.some((x, i) => i && !(x > w[i - 1] && f[i] > f[i - 1]))) {
      throw new Error(`${group}: expected speeds and thrusts that increase, one for each`);
    }
    if (w[0] > 0) [w, f].forEach((list) => list.unshift(0));
    w.slice(1).forEach((x, i) => {
      const a = (f[i + 1] - f[i]) / (x * x - w[i] * w[i]);
      pieces.push([w[i], a, 0, f[i] - a * (w[i] * w[i])]);
    });
  }
  if (pieces.length > SEGMENTS_MAX) throw new Error(`${group}: expected up to ${SEGMENTS_MAX} points`);
  return pieces.map(([start, a, b, c]) => ({start, abc: [a, b, c], level: (a * start + b) * start + c}));
}

/** Return bounds of thrusts and speeds of rotors with some health. */
export function bounds(vehicle, health) {
  const share = health.map((h) => (h < HEALTH_MIN ? 0 : h));
  const {curve} = vehicle;
  const measured = (speed, i) => {
    const [a, b, c] = curve.findLast(({start}) => start <= speed).abc;
    return share[i] * vehicle.forward[i] / vehicle.forward[0] * ((a * speed + b) * speed + c);
  };
  const thrust = (speed, i) => curve.length ? measured(speed, i) : speed < 0
    ? -(share[i] * vehicle.reverse[i] * (speed * speed))
    : share[i] * vehicle.forward[i] * (speed * speed);
  const turning = (speeds) => speeds.map((speed, i) => speed * (share[i] * vehicle.forward[i] > 0 ? 1 : 0));
  const factor = (coefficients) => coefficients.map((k, i) => (share[i] * k > 0 ? share[i] * k : 1));
  return {
    lower: vehicle.speedMin.map(thrust), upper: vehicle.speedMax.map(thrust),
    speedMin: turning(vehicle.speedMin), speedMax: turning(vehicle.speedMax),
    forward: factor(vehicle.forward), reverse: factor(vehicle.reverse),
  };
}
