// A flight in the kernel: the closed loop of flight.c, behind one method.
import {insist} from './settings.js';

export const STEP = 1e-3; // of the simulation [s]
export const ANNOUNCE = 0.1; // from a failure to its announcement to the allocator [s]
export const REST = [0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0];

const transposed = (a) => a.map((_, i) => a[i % 3 * 3 + Math.floor(i / 3)]);
const minor = (a, i, j) => [1, 2].flatMap((p) => [1, 2].map((q) => a[(i + p) % 3 * 3 + (j + q) % 3]));
const det2 = ([a, b, c, d]) => a * d - b * c;

function inverse(a) {
  const cofactors = a.map((_, k) => det2(minor(a, Math.floor(k / 3), k % 3)));
  const size = a[0] * cofactors[0] + a[1] * cofactors[1] + a[2] * cofactors[2];
  return transposed(cofactors).map((x) => x / size);
}

/** Return what moves a vehicle: mass, inertia and gains, as in C; or a line that says why it cannot fly here. */
export function bodyOf(get, given, wrenches) {
  if (given['vehicle.inertia'] === undefined) return 'A flight needs vehicle.inertia, which the file does not give.';
  if (get('controller.attitude') === 'pose') return 'The page does not fly with controller.attitude: pose.';
  const numbers = get('vehicle.inertia');
  const inertia = numbers.length === 9 ? numbers : [numbers[0], 0, 0, 0, numbers[1], 0, 0, 0, numbers[2]];
  const leading = [inertia[0], det2([inertia[0], inertia[1], inertia[3], inertia[4]]), 1 / inverse(inertia)[8]];
  insist(leading.every((x) => x > 0), 'vehicle.inertia: must be positive definite');
  const gain = (name) => {
    const values = [get(`controller.${name}`)].flat();
    return values.length === 1 ? Array(3).fill(values[0]) : values;
  };
  const mass = get('vehicle.mass');
  return {
    mass, burden: mass * get('vehicle.gravity') - get('vehicle.buoyancy'), inertia, inverse_inertia: inverse(inertia),
    effect: [0, 1, 2, 3, 4, 5].map((k) => wrenches.map((wrench) => wrench[k])),
    position_stiffness: gain('position_stiffness'), position_damping: gain('position_damping'),
    attitude_stiffness: gain('attitude_stiffness'), attitude_damping: gain('attitude_damping'),
    approach_max: get('controller.speed_max'), tilt_tangent: Math.tan(get('controller.tilt_max')),
  };
}

export class Flight {
  /** Start behind a method from a state (13), to a goal (x, y, z, heading), with the settings of a case. */
  constructor(kernel, vehicle, method, settings, goal, state = REST) {
    const {health} = settings;
    Object.assign(this, {kernel, vehicle, method, settings: {...settings, elapsed: 0}, goal, steps: 0, fallen: false});
    Object.assign(this, {health: [...health], announcements: []});
    kernel.begin(vehicle, this.settings, goal, state, STEP);
  }

  /** Let a rotor lose its thrust; the allocator learns of it a little later. */
  fail(rotor) {
    this.kernel.fail(rotor);
    this.announcements.push([this.steps + Math.round(ANNOUNCE / STEP), rotor]);
  }

  /** Fly some steps; a vehicle that tumbles too fast for them stays where it is. */
  advance(steps) {
    const end = this.steps + steps;
    while (this.steps < end && !this.fallen) {
      while (this.announcements[0]?.[0] <= this.steps) this.believe(this.announcements.shift()[1]);
      const until = Math.min(end, this.announcements[0]?.[0] ?? end);
      const flown = this.kernel.fly(this.method, until - this.steps, this.steps);
      this.fallen = flown < until - this.steps;
      this.steps += flown;
    }
    return this.kernel.flown(this.vehicle.n);
  }

  believe(rotor) {
    this.health[rotor] = 0;
    this.kernel.prepare(this.vehicle, this.health, this.settings);
  }
}
