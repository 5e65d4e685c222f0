// A vehicle in three dimensions: arms, rotors, and their thrusts as arrows.
import {Group, TorusGeometry, Vector3} from 'three';
import {color} from './stage.js';
import {kind} from './words.js';

const OUT = new Vector3(0, 0, 1), UP = new Vector3(0, 1, 0), LONGEST = 0.9;

export class Model {
  /** Put a vehicle on a stage; its farthest rotor is at 1. */
  constructor(stage, {arms, directions, speedMax, forward}, labelled = true) {
    this.group = new Group();
    this.size = Math.max(...arms.map((arm) => Math.hypot(...arm)));
    this.most = Math.max(...speedMax.map((s, i) => forward[i] * s * s));
    const places = arms.map((arm) => new Vector3(...arm).divideScalar(this.size));
    const gaps = places.flatMap((a, i) => places.slice(i + 1).map((b) => Math.hypot(a.x - b.x, a.y - b.y)));
    const radius = Math.min(0.45, 0.42 * Math.min(1, ...gaps.filter((gap) => gap > 1e-6)));
    stage.into(this.group, () => {
      stage.rod(new Vector3(0, 0, -0.05), new Vector3(0, 0, 0.05), 0.16, 'soft');
      stage.rod(new Vector3(0.16, 0, 0), new Vector3(0.34, 0, 0), 0.07, 'soft', 0);
      if (labelled) stage.label('front', new Vector3(0.5, 0, -0.16), 'tick');
      this.rotors = places.map((place, i) => rotor(stage, place, new Vector3(...directions[i]), radius, i));
      places.forEach((place, i) => {
        const outside = place.clone().setZ(0).normalize().multiplyScalar(radius + 0.12);
        if (labelled) stage.label(i + 1, place.clone().add(outside.setZ(Math.sign(place.z) * 0.08)), 'rotor');
      });
    });
  }

  /** Show the thrusts [N] of rotors with some health, and their bounds, if there are any. */
  show(health, {thrusts, saturation}, bounds) {
    this.rotors.forEach(({parts, cross, arrow, shaft, head, range}, i) => {
      const name = kind(health[i], saturation[i]), length = LONGEST * thrusts[i] / this.most, long = Math.abs(length);
      parts.forEach((part) => part.material.color.copy(color(name)));
      cross.visible = name === 'lost';
      arrow.visible = name !== 'lost' && long > 1e-3;
      arrow.scale.y = length < 0 ? -1 : 1;
      const tip = Math.min(0.16, long);
      shaft.scale.y = Math.max(1e-6, long - tip);
      shaft.position.y = (long - tip) / 2;
      head.scale.setScalar(tip / 0.16);
      head.position.y = long - tip / 2;
      range.visible = Boolean(bounds) && name !== 'lost';
      if (!range.visible) return;
      const [low, high] = [bounds.lower[i], bounds.upper[i]].map((f) => LONGEST * f / this.most);
      range.scale.y = Math.max(1e-6, high - low);
      range.position.copy(range.userData.axis).multiplyScalar((low + high) / 2).add(range.userData.place);
    });
  }
}

function rotor(stage, place, axis, radius, i) {
  const parts = [];
  stage.rod(new Vector3(0, 0, place.z * 0.5), place, 0.022, 'soft');
  const disc = stage.rod(place, place.clone().addScaledVector(axis, 0.015), radius, 'free', radius, 0.35);
  const ring = stage.add(new TorusGeometry(radius, 0.018, 8, 48), 'free');
  disc.userData.rotor = i;
  ring.position.copy(place);
  ring.quaternion.setFromUnitVectors(OUT, axis);
  const cross = new Group(), arrow = new Group();
  stage.into(cross, () => {
    for (const turn of [1, -1]) {
      const arm = new Vector3(1, turn, 0).normalize().multiplyScalar(radius);
      parts.push(stage.rod(arm.clone().negate(), arm, 0.025, 'lost'));
    }
  });
  cross.position.copy(place);
  cross.quaternion.copy(ring.quaternion);
  const [shaft, head] = stage.into(arrow, () => [
    stage.rod(new Vector3(0, -0.5, 0), new Vector3(0, 0.5, 0), 0.032, 'free'),
    stage.rod(new Vector3(0, -0.08, 0), new Vector3(0, 0.08, 0), 0.08, 'free', 0),
  ]);
  arrow.position.copy(place);
  arrow.quaternion.setFromUnitVectors(UP, axis);
  const range = stage.rod(new Vector3(0, -0.5, 0), new Vector3(0, 0.5, 0), 0.008, 'lost');
  range.quaternion.setFromUnitVectors(UP, axis);
  Object.assign(range.userData, {axis, place});
  return {disc, parts: [...parts, disc, ring, shaft, head], cross, arrow, shaft, head, range};
}
