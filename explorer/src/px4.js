// PX4's parameters of a multirotor, read and written as ca_ros.px4.parameters does, but for rotors that tilt.
import {insist} from './settings.js';
import {TILTING} from './vehicle.js';

const LINE = /^\s*(?:param\s+set(?:-default)?|\d+\s+\d+)\s+(CA_\w+)\s+(\S+)/gm;
const DEFAULTS = {PX: 0, PY: 0, PZ: 0, AX: 0, AY: 0, AZ: -1, CT: 6.5, KM: 0.05};
const FLIP = [1, -1, -1]; // forward-right-down and forward-left-up
const ROTORS_MAX = 12, WHOLE = ['CA_ROTOR_COUNT', 'CA_R_REV'];

/** What PX4 does not know of a vehicle, with values to begin with. */
export const ASKED = {
  mass: ['mass [kg]', 1.0], thrust: ['greatest thrust of the strongest rotor [N]', 5.0],
  speedMin: ['lowest rotor speed [rad/s]', 100], speedMax: ['highest rotor speed [rad/s]', 1000],
  length: ['length of an arm of 1 [m]', 1.0],
};

/** Return the parameters CA_* of an airframe or a file of QGroundControl; undefined if the text is another. */
export function readPx4(text) {
  const given = Object.fromEntries([...text.matchAll(LINE)].map(([, name, word]) => [name, Number(word)]));
  if (!Object.keys(given).length) return undefined;
  for (const [name, value] of Object.entries(given)) insist(Number.isFinite(value), `${name}: not a number`);
  insist('CA_ROTOR_COUNT' in given, 'no CA_ROTOR_COUNT: expected an airframe or a parameter file of QGroundControl');
  const tilts = Object.keys(given).find((name) => /^CA_ROTOR\d+_TILT$/.test(name) && given[name]);
  insist(!tilts, `${tilts}: rotors that tilt: ${TILTING}`);
  insist([0, 7].includes(given.CA_AIRFRAME ?? 0), `CA_AIRFRAME: expected 0 or 7, got ${given.CA_AIRFRAME}`);
  return given;
}

/** Return a parameter file of ca_ros, given also what is `ASKED`. */
export function fromPx4(given, {mass, thrust, speedMin, speedMax, length}, name) {
  const n = given.CA_ROTOR_COUNT;
  insist(Number.isInteger(n) && n >= 1 && n <= ROTORS_MAX, `CA_ROTOR_COUNT: expected 1 to ${ROTORS_MAX}, got ${n}`);
  insist(speedMax > 0 && thrust > 0, 'expected a positive thrust and highest speed');
  const rotors = Array.from({length: n}, (_, i) => Object.fromEntries(Object.entries(DEFAULTS)
    .map(([kind, value]) => [kind, given[`CA_ROTOR${i}_${kind}`] ?? value])));
  const strongest = Math.max(...rotors.map(({CT}) => CT)), coefficient = thrust / (speedMax * speedMax);
  const reactionless = rotors.every(({KM}) => KM === 0);
  rotors.forEach(({AX, AY, AZ, CT, KM}, i) => {
    const named = `CA_ROTOR${i} (rotor ${i + 1})`;
    insist((AX || AY || AZ) && CT, `${named} has no axis or no thrust: PX4 would ignore it`);
    insist(CT > 0, `${named}: CA_ROTOR${i}_CT is ${CT}: expected above 0`);
    insist(KM || reactionless, `${named}: CA_ROTOR${i}_KM is 0: expected its sign, the sense of rotation`);
  });
  const reverse = given.CA_R_REV ?? 0;
  insist(!reverse || speedMin < 0, 'CA_R_REV: motors reverse, so expected a lowest speed below 0');
  const forward = rotors.map(({CT}) => coefficient * CT / strongest);
  const flat = (kinds, scale) => rotors.flatMap((rotor) => kinds.map((kind, k) => scale(rotor) * FLIP[k] * rotor[kind] + 0));
  return JSON.stringify({'/**': {ros__parameters: {
    vehicle: {name, mass},
    rotors: {
      positions: flat(['PX', 'PY', 'PZ'], () => length),
      axes: flat(['AX', 'AY', 'AZ'], ({AX, AY, AZ}) => 1 / Math.hypot(AX, AY, AZ)),
      spins: rotors.map(({KM}, i) => (reactionless ? i % 2 === 0 : KM > 0) ? 'ccw' : 'cw'),
      thrust_coefficient: forward, torque_coefficient: forward.map((k, i) => k * Math.abs(rotors[i].KM)),
      speed_min: speedMin, speed_max: speedMax,
    }}}});
}

/** Return whether the positions may be relative to the greatest, as in many airframes. */
export function isNormalised(given) {
  return Math.max(...Object.entries(given).filter(([name]) => /^CA_ROTOR\d+_P[XY]$/.test(name))
    .map(([, x]) => Math.abs(x))) === 1;
}

/** Return a vehicle's geometry as a parameter file of QGroundControl. */
export function toPx4({n, arms, directions, forward, torque, spins, speedMin, fullThrusts}) {
  insist(n <= ROTORS_MAX, `${n} rotors, but PX4 has ${ROTORS_MAX} at most`);
  const most = Math.max(...fullThrusts), found = {CA_ROTOR_COUNT: n};
  for (let i = 0; i < n; i++) {
    const flip = (values) => values.map((x, k) => FLIP[k] * x + 0);
    const values = [...flip(arms[i]), ...flip(directions[i]), DEFAULTS.CT * fullThrusts[i] / most,
      (spins[i] === 'cw' ? -1 : 1) * torque[i] / forward[i]];
    Object.keys(DEFAULTS).forEach((kind, k) => { found[`CA_ROTOR${i}_${kind}`] = values[k]; });
  }
  const reversing = speedMin.reduce((mask, speed, i) => mask | (speed < 0) << i, 0);
  if (reversing) found.CA_R_REV = reversing;
  const lines = Object.entries(found).map(([name, value]) =>
    `1\t1\t${name}\t${+value.toPrecision(9)}\t${WHOLE.includes(name) ? 6 : 9}`);
  return `# Vehicle-Id Component-Id Name Value Type\n${lines.join('\n')}\n`;
}
