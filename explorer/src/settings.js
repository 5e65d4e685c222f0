// The settings in a parameter file, checked as ca_ros.settings does, by Python's own table of them.
import {load} from 'js-yaml';

/** By name the settings that a vehicle and its allocation can have; see ca_ros.explore.settings. */
export const FIELDS = SETTINGS.fields;

const isMap = (value) => value !== null && typeof value === 'object' && !Array.isArray(value);

/** Return the value of a setting with its type, or say what is wrong with it. */
export function check(name, value, field) {
  const size = Array.isArray(value) ? value.length : 1;
  if (Array.isArray(value) && !field.array) {
    throw new Error(`${name}: expected one value (${field.range}), got ${size}`);
  }
  if (field.sizes && !field.sizes.includes(size)) {
    throw new Error(`${name}: expected ${field.sizes.join(' or ')} values, got ${size}`);
  }
  if (Array.isArray(value)) {
    const entry = {...field, array: false, sizes: null};
    return value.map((each, i) => check(`${name}[${i}]`, each, entry));
  }
  const found = field.words ? word(value, field) : number(value, field);
  if (found === undefined) {
    throw new Error(`${name}: must be ${field.range}, got ${String(JSON.stringify(value)).slice(0, 80)}`);
  }
  return found;
}

function word(value, {choices}) {
  const sound = typeof value === 'string' && !/[\p{Cc}\u2028\u2029]/u.test(value);
  return sound && (!choices.length || choices.includes(value)) ? value : undefined;
}

function number(value, {minimum, maximum, whole}) {
  const isNumber = typeof value === 'number' || (typeof value === 'string' && value.trim());
  const x = isNumber ? Number(value) : NaN;
  return x >= minimum && x <= maximum && !(whole && x % 1) ? x : undefined;
}

/** Return what a file gives the allocator, by full name. */
function given(text) {
  let content;
  try {
    content = load(text);
  } catch (error) {
    throw new Error(`not readable YAML: ${String(error.message).split('\n')[0]}`);
  }
  if (content?.problem) throw new Error('a problem without a vehicle, which has no rotors to show');
  const found = {};
  const flatten = (tree, prefix) => {
    for (const [key, value] of Object.entries(tree)) {
      const name = prefix + key;
      if (isMap(value)) flatten(value, `${name}.`);
      else found[SETTINGS.renamed[name] ?? name] = value;
    }
  };
  let sections = 0;
  const visit = (tree, node) => {
    for (const [key, below] of Object.entries(tree)) {
      if (!isMap(below)) continue;
      if (key !== 'ros__parameters') visit(below, key.split('/').at(-1));
      else if (/(\*|^allocator)$/.test(node)) flatten(below, '', ++sections);
    }
  };
  if (isMap(content)) visit(content, '');
  if (!sections) throw new Error("expected a ROS parameter file: '/**:' and 'ros__parameters:'");
  return found;
}

/** Return a function that returns settings by name, and what the file gives of them. */
export function readSettings(text) {
  const found = Object.entries(given(text)).filter(([name]) => /^(vehicle|rotors|allocation)(\.|$)/.test(name));
  const values = new Map();
  for (const [name, value] of found) {
    if (name in FIELDS) values.set(name, check(name, value, FIELDS[name]));
    else if (/^(vehicle|rotors|allocation\.exact)\b|^allocation\.\w+$/.test(name)) throw new Error(`${name}: no such parameter`);
  }
  const get = (name) => {
    const value = values.get(name) ?? FIELDS[name].default;
    if (value === null) throw new Error(`${name}: missing; it is the ${FIELDS[name].description}`);
    return value;
  };
  return [get, Object.fromEntries(found)];
}
