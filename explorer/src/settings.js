// The settings in a parameter file, checked as ca_ros.settings does, by Python's own table of them.
import {load} from 'js-yaml';

/** By name the settings that a vehicle and its allocation can have; see settings.py. */
export const FIELDS = SETTINGS.fields;

export function insist(sound, message) {
  if (!sound) throw new Error(message);
}

const isMap = (value) => value !== null && typeof value === 'object' && !Array.isArray(value);

/** Return the value of a setting with its type, or say what is wrong with it. */
export function check(name, value, field) {
  const {array, sizes, range} = field, isList = Array.isArray(value), size = isList ? value.length : 1;
  insist(array || !isList, `${name}: expected one value (${range}), got ${size}`);
  insist(!sizes || sizes.includes(size), `${name}: expected ${sizes?.join(' or ')} values, got ${size}`);
  const one = {...field, array: false, sizes: null};
  if (isList) return value.map((entry, i) => check(`${name}[${i}]`, entry, one));
  const found = (field.words ? word : number)(value, field);
  insist(found !== undefined, `${name}: must be ${range}, got ${String(JSON.stringify(value)).slice(0, 80)}`);
  return found;
}

function word(value, {choices}) {
  const sound = typeof value === 'string' && !/[\p{Cc}\u2028\u2029]/u.test(value);
  return sound && (!choices.length || choices.includes(value)) ? value : undefined;
}

function number(value, {minimum, maximum, whole}) {
  const x = typeof value === 'number' || (typeof value === 'string' && value.trim()) ? Number(value) : NaN;
  return x >= minimum && x <= maximum && !(whole && x % 1) ? x : undefined;
}

/** Return what a file gives the allocator, by full name. */
function given(text) {
  let content, sections = 0;
  try {
    content = load(text);
  } catch (error) {
    throw new Error(`not readable YAML: ${String(error.message).split('\n')[0]}`);
  }
  insist(!content?.problem, 'a problem without a vehicle: this page draws rotors; ca_ros attainable draws the set of a matrix');
  const found = {}, entries = (tree) => isMap(tree) ? Object.entries(tree) : [];
  const flatten = (tree, prefix) => entries(tree).forEach(([key, value]) => {
    const name = prefix + key;
    if (isMap(value)) flatten(value, `${name}.`);
    else found[SETTINGS.renamed[name] ?? name] = value;
  });
  const visit = (tree, node) => entries(tree).forEach(([key, below]) => {
    if (key !== 'ros__parameters') visit(below, key.split('/').at(-1));
    else if (isMap(below) && /(\*|^allocator)$/.test(node)) flatten(below, '', ++sections);
  });
  visit(content, '');
  insist(sections, "expected a ROS parameter file: '/**:' and 'ros__parameters:'");
  return found;
}

/** Return a function that returns settings by name, and what the file gives of them. */
export function readSettings(text) {
  const found = Object.entries(given(text)).filter(([name]) => /^(vehicle|rotors|allocation|controller)(\.|$)/.test(name));
  const values = {};
  for (const [name, value] of found) {
    if (Object.hasOwn(FIELDS, name)) values[name] = check(name, value, FIELDS[name]);
    else insist(!/^(vehicle|rotors|controller|allocation\.exact)\b|^allocation\.\w+$/.test(name), `${name}: no such parameter`);
  }
  const get = (name) => {
    const value = values[name] ?? FIELDS[name].default;
    insist(value !== null, `${name}: missing; it is the ${FIELDS[name].description}`);
    return value;
  };
  return [get, Object.fromEntries(found)];
}
