// The pseudo-inverse of a vehicle as the mixer of another autopilot, as ca_ros.vehicle.formats.mixers.
import {dot} from './kernel.js';
import {insist} from './settings.js';

const AXES = ['thrust', 'roll', 'pitch', 'yaw'];
const SIGNS = {betaflight: [1, 1, 1, -1], ardupilot: [1, 1, -1, -1]}, MOTORS = {betaflight: 8, ardupilot: 12};
const UPRIGHT = 1 - 1e-6, SAME = 1e-6, SINGULAR = 1e-9;

/** Return the factors of each motor, from those of thrust to those of yaw. */
function mixer({n, axes, directions, gamma, lowerThrusts, upperThrusts}, style) {
  insist(n <= MOTORS[style], `${n} rotors, but ${style} has ${MOTORS[style]} motors at most`);
  insist(String(axes) === String(AXES), `mixers have the axes ${AXES.join(', ')}; this vehicle has ${axes.join(', ')}`);
  insist(directions.every(([, , z]) => z >= UPRIGHT), 'a mixer is for rotors that point upwards: rotors.axes');
  const top = Math.max(...upperThrusts), differ = (list) => Math.max(...list) - Math.min(...list) > SAME * top;
  insist(!differ(lowerThrusts) && !differ(upperThrusts),
    'the rotors have unequal ranges of thrust; these mixers take one range for all motors');
  // G' (G G')^-1, with the rows at the same length.
  const rows = gamma.map((row) => row.map((x) => x / (Math.hypot(...row) || 1)));
  const inverse = inverted(rows.map((a) => rows.map((b) => dot(a, b))));
  const columns = AXES.map((_, k) => rows[0].map((__, i) => dot(rows.map((row) => row[i]), inverse[k])));
  const scaled = columns.map((column, k) => {
    const most = Math.max(...column.map(Math.abs));
    return column.map((x) => +(SIGNS[style][k] * x / most).toFixed(6) + 0);
  });
  return rows[0].map((_, i) => scaled.map((column) => column[i]));
}

/** Return the inverse of a symmetric positive matrix. */
function inverted(matrix) {
  const size = matrix.length, work = matrix.map((row, i) => [...row, ...row.map((_, j) => +(i === j))]);
  for (let k = 0; k < size; k++) {
    insist(work[k][k] > SINGULAR, 'the rotors cannot control all four axes: see ca_ros audit');
    work[k] = work[k].map((x) => x / work[k][k]);
    for (let i = 0; i < size; i++) {
      const factor = work[i][k];
      if (i !== k) work[i] = work[i].map((x, j) => x - factor * work[k][j]);
    }
  }
  return work.map((row) => row.slice(size));
}

/** Return the commands of Betaflight's command line. */
export function toBetaflight(vehicle) {
  const lines = mixer(vehicle, 'betaflight').map((row, motor) =>
    `mmix ${motor} ${row.map((x) => x.toFixed(3)).join(' ')}`);
  return ['mixer CUSTOM', 'mmix reset', ...lines, 'save', ''].join('\n');
}

/** Return a Lua script for ArduPilot's scripting matrix. */
export function toArduPilot(vehicle) {
  const rows = mixer(vehicle, 'ardupilot'), six = (x) => x.toFixed(6);
  const lines = rows.flatMap(([thrust, roll, pitch, yaw], motor) => [
    `MotorsMatrix:add_motor_raw(${motor}, ${six(roll)}, ${six(pitch)}, ${six(yaw)}, ${motor + 1})`,
    ...(Math.abs(thrust - 1) > SAME ? [`MotorsMatrix:set_throttle_factor(${motor}, ${six(thrust)})`] : []),
  ]);
  return [`-- ${rows.length} motors; set FRAME_CLASS to 15, SCR_ENABLE to 1`, ...lines,
    `assert(MotorsMatrix:init(${rows.length}), 'the motors were not set up')`,
    "motors:set_frame_string('ca_ros')", ''].join('\n');
}
