// What the numbers of the kernel mean, in words.
export const UNITS = {force_x: 'N', force_y: 'N', thrust: 'N', roll: 'N\xa0m', pitch: 'N\xa0m',
  yaw: 'N\xa0m'};
export const METHODS = {'': 'no other method', pseudo_inverse: 'clipped pseudo-inverse',
  fixed_pseudo_inverse: 'clipped pseudo-inverse, computed once'};
const BOUNDS = [['at maximum', 1], ['at minimum', -1]];
const CAUSES = [...BOUNDS, ['speeding up', 2], ['slowing down', -2], ['lost or weak', 3],
  ['lost or weak', -3]];
const TOGETHER = 2; // how rotors limit an axis that only all of them together would bring nearer
const NEAR = 1e-6; // shortfall that counts as none, as a share of half of the axis's range

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
export const kind = (health, saturation) => health < 1e-9 ? 'lost' : ['min', 'free', 'max'][saturation + 1];

/** Return the lines that explain an answer. */
export function explain({vehicle, state, set}, answer, beside, hover) {
  const {axes} = vehicle, lost = numbers(state.health.map((h) => h < 1e-9), true);
  if (set.fault) return [`No axis can be controlled: ${lost.length ? `${rotors(lost)} lost` : 'too few rotors'}.`];
  const missing = ({wrench}) => axes.flatMap((axis, k) => short(set.extent[k], state.demand[k], wrench[k])
    ? [`${axis} ${digits(wrench[k])} instead of ${digits(state.demand[k])} ${UNITS[axis]}`] : []).join(', ');
  const near = which(answer.limit.map((flag, i) => set.upper[i] > set.lower[i] ? flag : 0), BOUNDS);
  const lines = {
    EXACT: [`Served in full; ${digits(answer.margin)} from the limit with ${listed(near)}.`],
    REJECTED: ['Not attainable, and rejected: all rotors are as slow as possible.'],
  }[answer.status] ?? [`Not attainable${answer.status === 'RATE_LIMITED' ? ' yet' : ''}: ${missing(answer)}.`,
    ...reasons(axes, answer)];
  if (set.lost.length) lines.push(`Lost: ${listed(set.lost)}. The rotors cannot control it independently.`);
  const what = hovers(vehicle, set, hover);
  if (lost.length) lines.push(`${capital(rotors(lost))} lost: ${what}`);
  else if (hover.status !== 'EXACT') lines.push(`${capital(what)} Check mass and rotors.`);
  if (beside) lines.push(`${capital(METHODS[state.beside])}: ${missing(beside) || 'served in full'}.`);
  return lines;
}

/** Say which rotors, or the limit on airmode, keep an axis from its demand. */
function reasons(axes, {blocks, cause, airmodeBlocks, served}) {
  const limited = {};
  axes.forEach((axis, k) => {
    const what = [...which(blocks[k].map((how, i) => how && cause[i]), CAUSES),
      ...(airmodeBlocks[k] ? ['the limit on airmode'] : [])].join(', ') || 'the priorities';
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
