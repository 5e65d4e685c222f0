// What the two stages show: the vehicle with its thrusts, and the attainable set with the demand.
import {CylinderGeometry, OctahedronGeometry, SphereGeometry, TorusGeometry, Vector3} from 'three';
import {color, vector} from './stage.js';

export const UNITS = {force_x: 'N', force_y: 'N', thrust: 'N', roll: 'N m', pitch: 'N m', yaw: 'N m'};
const UP = new Vector3(0, 1, 0), OUT = new Vector3(0, 0, 1);

/** The colour of a rotor: lost, at a bound, or free. */
export const kind = (health, saturation) => health < 1e-9 ? 'lost' : ['min', 'free', 'max'][saturation + 1];

export function drawVehicle(stage, vehicle, health, limits, answer) {
  stage.clear();
  const size = Math.max(...vehicle.arms.map((arm) => Math.hypot(...arm))), places = vehicle.arms.map((arm) => vector(arm).divideScalar(size));
  const gaps = places.flatMap((a, i) => places.slice(i + 1).map((b) => Math.hypot(a.x - b.x, a.y - b.y))).filter((gap) => gap > 1e-6);
  const radius = Math.min(0.45, 0.42 * Math.min(1, ...gaps)), most = Math.max(...vehicle.speedMax.map((s, i) => vehicle.forward[i] * s * s));
  stage.rod(new Vector3(0, 0, -0.05), new Vector3(0, 0, 0.05), 0.16, 'soft');
  stage.rod(new Vector3(0.16, 0, 0), new Vector3(0.34, 0, 0), 0.07, 'soft', 0);
  stage.label('front', new Vector3(0.42, 0, -0.12), 'tick');
  places.forEach((place, i) => {
    const name = kind(health[i], answer.saturation[i]), axis = vector(vehicle.directions[i]);
    const end = (thrust) => place.clone().addScaledVector(axis, 0.9 * thrust / most);
    stage.rod(new Vector3(0, 0, place.z * 0.5), place, 0.022, 'soft');
    stage.rod(place, place.clone().addScaledVector(axis, 0.015), radius, name, radius, 0.35).userData.rotor = i;
    const ring = stage.add(new TorusGeometry(radius, 0.018, 8, 48), name);
    ring.position.copy(place);
    ring.quaternion.setFromUnitVectors(OUT, axis);
    if (name === 'lost') {
      for (const turn of [1, -1]) {
        const arm = new Vector3(1, turn, 0).normalize().multiplyScalar(radius).applyQuaternion(ring.quaternion);
        stage.rod(place.clone().sub(arm), place.clone().add(arm), 0.025, name);
      }
    } else {
      // The bounds as a thin line, the thrust as an arrow.
      stage.rod(end(limits.lower[i]), end(limits.upper[i]), 0.008, 'lost');
      const tip = end(answer.thrusts[i]), way = tip.clone().sub(place), length = way.length(), head = Math.min(0.16, length);
      if (length > 1e-3) {
        const neck = tip.clone().addScaledVector(way.normalize(), -head);
        if (length > head) stage.rod(place, neck, 0.032, name);
        stage.rod(neck, tip, 0.08 * Math.min(1, head / 0.1), name, 0);
      }
    }
    const outside = place.clone().setZ(0).normalize().multiplyScalar(radius + 0.12).setZ(Math.sign(place.z) * 0.08);
    stage.label(i + 1, place.clone().add(outside), 'rotor');
  });
  stage.draw();
}

/** Draw the attainable set over the shown axes, in units of half of their ranges. */
export function drawSet(stage, {axes, shown, set, sets, demand, served, beside, start}) {
  stage.clear();
  const scaled = (u, k) => (u[k] - set.center[k]) / set.extent[k], value = (x, k) => set.center[k] + x * set.extent[k];
  const spot = (u) => new Vector3(...shown.map((k) => scaled(u, k)), ...(shown.length < 3 ? [0] : [])), flat = shown.length < 3;
  sets.forEach((polygons, i) => {
    const edges = polygons.flatMap((corners) => corners.map((corner, j) => [...corner, ...corners[(j + 1) % corners.length]]));
    if (i === 0) stage.polygons(polygons, 'face', flat ? 0.35 : 0.3);
    if (edges.length) stage.lines(edges, i ? 'soft' : 'free', i ? 1 : 1.6, i ? {dashed: true, dashSize: 0.05, gapSize: 0.04} : {});
  });
  const middle = spot(start);
  shown.forEach((k, place) => {
    const on = (x) => middle.clone().setComponent(place, x), unit = UNITS[axes[k]], step = nice(value(1, k) - value(0, k));
    stage.lines([[...on(-1.12), ...on(1.12)]], 'soft', 1);
    stage.label(`${axes[k]} [${unit}]`, on(flat && place === 0 ? 1.12 : 1.25).add(flat && place === 0 ? new Vector3(-0.12, 0.1, 0) : new Vector3()), '');
    for (let t = Math.ceil(value(-1.05, k) / step); t * step <= value(1.05, k); t++) {
      const at = on(scaled(start.map((u, j) => j === k ? t * step : u), k));
      stage.rod(at.clone().addScalar(-1e-3), at, 0.012, 'soft');
      if (t || place === 0) stage.label(`${+(t * step).toPrecision(3)}`, at.add(flat && place ? new Vector3(-0.12, 0, 0) : flat
        ? new Vector3(0, -0.08, 0) : new Vector3(0, 0, -0.09)), 'tick');
    }
  });
  const dot = (u, geometry, name) => {
    const mesh = stage.add(geometry, name, 1, {depthTest: false, transparent: true});
    mesh.position.copy(spot(u));
    mesh.renderOrder = 2;
    return mesh;
  };
  stage.lines([[...spot(demand), ...spot(served)]], 'demand', 2, {dashed: true, dashSize: 0.04, gapSize: 0.03, depthTest: false, transparent: true});
  if (beside) {
    stage.lines([[...spot(demand), ...spot(beside)]], 'beside', 2, {dashed: true, dashSize: 0.04, gapSize: 0.03, depthTest: false, transparent: true});
    dot(beside, new OctahedronGeometry(0.055), 'beside');
  }
  dot(served, new SphereGeometry(0.045, 24, 16), 'served');
  dot(demand, new TorusGeometry(0.075, 0.016, 10, 40), 'demand').quaternion.copy(stage.camera.quaternion);
  stage.demand = spot(demand);
  stage.draw();
}

function nice(half) {
  const power = 10 ** Math.floor(Math.log10(half));
  return [0.5, 1, 2, 5].map((digit) => digit * power).findLast((step) => half / step >= 1.4) ?? power / 2;
}
