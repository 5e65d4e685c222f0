// What the numbers of the kernel mean, in words.
export const UNITS = {force_x: 'N', force_y: 'N', thrust: 'N', roll: 'N\xa0m', pitch: 'N\xa0m',
  yaw: 'N\xa0m'};
export const METHODS = {'': 'no other method', pseudo_inverse: 'clipped pseudo-inverse',
  fixed_pseudo_inverse: 'clipped pseudo-inverse, computed once',
  pseudo_inverse_of_all_axes: 'clipped pseudo-inverse of all axes'};
const BOUNDS = [['at maximum', 1], ['at minimum', -1]];
const TOGETHER = 2; // how rotors limit an axis that only all of them together would bring nearer
const LOST = 1e-9, NEAR = 1e-6; // shortfall that counts as none, as a share of half of the axis's range

export const digits = (x) => String(Math.abs(x) < 1e-9 ? 0 : Number(x.toPrecision(3)));
const listed = (words) => words.length > 1 ? `${words.slice(0, -1).join(', ')} and ${words.at(-1)}`
  : words.join('');
const capital = (words) => words[0].toUpperCase() + words.slice(1);
const numbers = (flags, value) => flags.flatMap((flag, i) => flag === value ? [i + 1] : []);
const rotors = (some) => `rotor${some.length > 1 ? 's' : ''} ${listed(some)}`;
/** Return which rotors have which of the flags, such as "rotors 1 and 2 at maximum". */
const which = (flags, names) => names.flatMap(([name, flag]) => {
  const some = numbers(flags, flag);
  return some.length ? [`${rotors(some)} ${name}`] : [];
});

/** Return whether an axis does not get what is asked. */
export const short = (extent, asked, got) => Math.abs(asked - got) > NEAR * extent;

/** Return the colour of a rotor: failed, at a bound, or free. */
export const kind = (health, saturation) => health < LOST ? 'lost' : ['min', 'free', 'max'][saturation + 1];

/** Return one sentence: what exact gives of the demand, and what another method gives. */
export function compared({vehicle: {axes}, state, set}, answer, beside) {
  if (set.fault) return 'No axis can be controlled.';
  const gives = ({wrench}) => {
    const off = axes.flatMap((axis, k) => set.kept.includes(axis) && short(set.extent[k], state.demand[k], wrench[k])
      ? [`${axis} ${digits(wrench[k])} instead of ${digits(state.demand[k])} ${UNITS[axis]}`] : []);
    return off.length ? `gives ${listed(off)}` : 'serves the demand in full';
  };
  const lost = set.lost.length ? `, without ${listed(set.lost)}` : '';
  const other = beside ? `; the ${METHODS[state.beside]} ${gives(beside)}` : '';
  return `exact ${answer.status === 'REJECTED' ? 'rejects the demand' : gives(answer)}${lost}${other}.`;
}

/** Return the lines that explain an answer. */
export function explain({vehicle, state, set}, answer, hover) {
  const {axes} = vehicle, lost = numbers(state.health.map((h) => h < LOST), true);
  if (set.fault) return [`No axis can be controlled: ${lost.length ? `${rotors(lost)} lost` : 'too few rotors'}.`];
  const near = which(answer.limit.map((flag, i) => set.upper[i] > set.lower[i] ? flag : 0), BOUNDS);
  const lines = {
    EXACT: [`The demand is ${digits(answer.margin)} inside the limit that ${listed(near)} set.`],
    REJECTED: ['The demand is not attainable, and rejected: all rotors are as slow as possible.'],
  }[answer.status] ?? [`The demand is not attainable${answer.status === 'RATE_LIMITED' ? ' yet' : ''}: it is ${
    digits(-answer.margin)} outside the limit.`, ...reasons(vehicle, state, set, answer)];
  if (set.lost.length) {
    const asked = axes.filter((axis, k) => set.lost.includes(axis) && state.demand[k]);
    lines.push(`${capital(listed(set.lost))} ${set.lost.length > 1 ? 'are' : 'is'} lost: the rotors cannot control ${
      set.lost.length > 1 ? 'them' : 'it'} independently${asked.length ? ', and the demand of it is ignored' : ''}.`);
  }
  const what = hovers(vehicle, set, hover);
  if (lost.length) lines.push(`${capital(rotors(lost))} lost: ${what}`);
  else if (hover.status !== 'EXACT') lines.push(`${capital(what)} Check mass and rotors.`);
  return lines;
}

/** Say which rotors, or the limit on airmode, keep an axis from its demand. */
function reasons({axes}, {health}, set, {blocks, cause, airmodeBlocks, served}) {
  const limited = {};
  axes.forEach((axis, k) => {
    if (!set.kept.includes(axis)) return;
    const flags = blocks[k].map((how, i) => how && (Math.abs(cause[i]) === 3 && health[i] < LOST ? 4 : cause[i]));
    const causes = [...BOUNDS, ['speeding up', 2], ['slowing down', -2], ['weak', 3], ['weak', -3], ['lost', 4]];
    const what = [...which(flags, causes),
      ...(airmodeBlocks[k] ? ['the limit on airmode'] : [])].join(', ') || 'axes that come first';
    const how = blocks[k].includes(TOGETHER) ? ', together' : '';
    if (served[k] < 1) (limited[what + how] ??= []).push(axis);
  });
  return Object.entries(limited).map(([what, some]) => `What limits ${listed(some)}: ${what}.`);
}

function hovers({axes, reference}, {extent}, {wrench, margin}) {
  const off = axes.filter((_, k) => short(extent[k], reference[k], wrench[k]));
  if (!off.length) return `hover is still attainable, ${digits(margin)} from the limit.`;
  if (String(off) !== 'yaw') return `hover is not attainable (${listed(off)}).`;
  return `hover leaves a yaw torque of ${digits(wrench[axes.indexOf('yaw')])} N m, so the vehicle spins.`;
}

/** Words of the page, each with what it means. */
export const GLOSSARY = {
  demand: 'The wrench that a controller asks for: thrust [N] and torques about x, y and z [N m].',
  'forward, left, up': 'The frame of the body: x forward, y left, z up. A positive roll lowers the right side, a ' +
    'positive pitch the nose, a positive yaw turns to the left.',
  'attainable set': 'All wrenches that the rotors can produce within their bounds (attainable moment set). Its ' +
    'walls are where rotors are at their minimum or maximum.',
  margin: 'Distance of the demand from the nearest wall of the set, as length of the difference of wrenches; ' +
    'negative outside. N and N m count alike.',
  exact: 'The method of ca_ros: the rotor thrusts of least norm that produce the demand, if any do; otherwise axes ' +
    'are served in the order of the priorities.',
  'clipped pseudo-inverse': 'The usual method: the pseudo-inverse of the control allocation matrix times the demand, ' +
    'clipped to the bounds. Computed once: it does not know of lost rotors. Of all axes: also of those that the ' +
    'rotors cannot control independently.',
  airmode: 'Thrust is raised so that roll and pitch can be served at low thrust. The limit says by how much.',
  'EXACT, PRIORITIZED, SCALED, REJECTED': 'The demand is served in full; by priority; scaled towards hover; not.',
  RATE_LIMITED: 'The demand is attainable, but not yet: the rotors have not had the time to change their speeds.',
};
