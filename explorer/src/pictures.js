// What the two stages show: the vehicle with its thrusts, and the attainable set with the demand.
import {OctahedronGeometry, SphereGeometry, TorusGeometry, Vector3} from 'three';
import {kind, UNITS} from './words.js';

const OUT = new Vector3(0, 0, 1), ON_TOP = {depthTest: false, transparent: true};
const DASHES = {dashed: true, dashSize: 0.04, gapSize: 0.03};

export function drawVehicle(stage, {arms, directions, speedMax, forward}, health, limits, answer) {
  stage.clear();
  const size = Math.max(...arms.map((arm) => Math.hypot(...arm)));
  const places = arms.map((arm) => new Vector3(...arm).divideScalar(size));
  const gaps = places.flatMap((a, i) => places.slice(i + 1).map((b) => Math.hypot(a.x - b.x, a.y - b.y)));
  const radius = Math.min(0.45, 0.42 * Math.min(1, ...gaps.filter((gap) => gap > 1e-6)));
  const most = Math.max(...speedMax.map((s, i) => forward[i] * s * s));
  stage.rod(new Vector3(0, 0, -0.05), new Vector3(0, 0, 0.05), 0.16, 'soft');
  stage.rod(new Vector3(0.16, 0, 0), new Vector3(0.34, 0, 0), 0.07, 'soft', 0);
  stage.label('front', new Vector3(0.5, 0, -0.16), 'tick');
  places.forEach((place, i) => {
    const name = kind(health[i], answer.saturation[i]), axis = new Vector3(...directions[i]);
    const along = (length) => place.clone().addScaledVector(axis, length),
      end = (thrust) => along(0.9 * thrust / most);
    stage.rod(new Vector3(0, 0, place.z * 0.5), place, 0.022, 'soft');
    stage.rod(place, along(0.015), radius, name, radius, 0.35).userData.rotor = i;
    const ring = stage.add(new TorusGeometry(radius, 0.018, 8, 48), name);
    ring.position.copy(place);
    ring.quaternion.setFromUnitVectors(OUT, axis);
    if (name === 'lost') {
      for (const turn of [1, -1]) {
        const arm = new Vector3(1, turn, 0).normalize().multiplyScalar(radius)
          .applyQuaternion(ring.quaternion);
        stage.rod(place.clone().sub(arm), place.clone().add(arm), 0.025, name);
      }
    } else {
      // The bounds as a thin line, the thrust as an arrow.
      stage.rod(end(limits.lower[i]), end(limits.upper[i]), 0.008, 'lost');
      const tip = end(answer.thrusts[i]), way = tip.clone().sub(place), length = way.length();
      const head = Math.min(0.16, length), neck = tip.clone().addScaledVector(way.normalize(), -head);
      if (length > head) stage.rod(place, neck, 0.032, name);
      if (length > 1e-3) stage.rod(neck, tip, 0.08 * Math.min(1, head / 0.1), name, 0);
    }
    const outside = place.clone().setZ(0).normalize().multiplyScalar(radius + 0.12);
    stage.label(i + 1, place.clone().add(outside.setZ(Math.sign(place.z) * 0.08)), 'rotor');
  });
  stage.draw();
}

/** Draw the attainable set over the shown axes, in units of half of their ranges. */
export function drawSet(stage, {axes, shown, set, sets, demand, served, beside, start}) {
  stage.clear();
  const scaled = (u, k) => (u[k] - set.center[k]) / set.extent[k],
    value = (x, k) => set.center[k] + x * set.extent[k];
  const flat = shown.length < 3,
    spot = (u) => new Vector3(...shown.map((k) => scaled(u, k)), ...(flat ? [0] : []));
  sets.forEach((polygons, i) => {
    const edges = polygons.flatMap((corners) =>
      corners.map((corner, j) => [...corner, ...corners[(j + 1) % corners.length]]));
    if (i === 0) stage.polygons(polygons, 'face', flat ? 0.35 : 0.3);
    if (edges.length) stage.lines(edges, i ? 'soft' : 'free', i ? 1 : 1.6, i ? DASHES : {});
  });
  const middle = spot(start), below = flat ? new Vector3(0, -0.08, 0) : new Vector3(0, 0, -0.09);
  shown.forEach((k, place) => {
    const on = (x) => middle.clone().setComponent(place, x), step = nice(value(1, k) - value(0, k));
    const name = flat && !place ? on(1).add(new Vector3(0, 0.1, 0)) : on(flat ? 1.12 : 1.25);
    const aside = flat && place ? new Vector3(-0.12, 0, 0) : below;
    stage.lines([[...on(-1.12), ...on(1.12)]], 'soft', 1);
    stage.label(`${axes[k]} [${UNITS[axes[k]]}]`, name, '');
    for (let t = Math.ceil(value(-1.05, k) / step); t * step <= value(1.05, k); t++) {
      const at = on(scaled(start.map((u, j) => j === k ? t * step : u), k));
      stage.rod(at.clone().addScalar(-1e-3), at, 0.012, 'soft');
      if (t || place === 0) stage.label(`${+(t * step).toPrecision(3)}`, at.add(aside), 'tick');
    }
  });
  const dot = (u, geometry, name) => {
    const mesh = stage.add(geometry, name, 1, ON_TOP);
    mesh.position.copy(spot(u));
    mesh.renderOrder = 2;
    return mesh;
  };
  const miss = (u, name) => stage.lines([[...spot(demand), ...spot(u)]], name, 2, {...DASHES, ...ON_TOP});
  miss(served, 'demand');
  if (beside) {
    miss(beside, 'beside');
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
