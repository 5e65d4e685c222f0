// What the page writes of a vehicle for other programs: by name its label, the end of the file's name, and its text.
import {toArduPilot, toBetaflight} from './mixers.js';
import {toPx4} from './px4.js';
import {FIELDS} from './settings.js';

/** One more format is one more entry. */
export const EXPORTS = {
  px4: {label: 'PX4 parameters', end: '.params', text: toPx4},
  betaflight: {label: 'Betaflight mixer', end: '_mmix.txt', text: toBetaflight},
  ardupilot: {label: 'ArduPilot mixer (Lua)', end: '.lua', text: toArduPilot},
  yaml: {label: 'ca_ros parameter file', end: '.yaml', text: ({given}) => parameterFile(given)},
};

/** Return a parameter file; floats have a point, for ROS tells them from whole numbers. */
export function parameterFile(given) {
  const one = (value, whole) => typeof value !== 'number' ? JSON.stringify(value)
    : whole || !Number.isInteger(value) ? String(value) : value.toFixed(1);
  const lines = ['/**:', '  ros__parameters:'];
  let open = [];
  for (const [name, value] of Object.entries(given).sort(([a], [b]) => (a < b ? -1 : 1))) {
    const parts = name.split('.'), last = parts.pop(), {whole} = FIELDS[name] ?? {};
    const same = parts.findIndex((part, i) => part !== open[i]);
    for (let i = same < 0 ? parts.length : same; i < parts.length; i++) lines.push(`${'  '.repeat(2 + i)}${parts[i]}:`);
    open = parts;
    const text = Array.isArray(value) ? `[${value.map((each) => one(each, whole)).join(', ')}]` : one(value, whole);
    lines.push(`${'  '.repeat(2 + parts.length)}${last}: ${text}`);
  }
  return `${lines.join('\n')}\n`;
}

/** Offer a text as a file. */
export function download(name, text) {
  const link = Object.assign(document.createElement('a'), {
    download: name, href: URL.createObjectURL(new Blob([text], {type: 'text/plain'}))});
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
