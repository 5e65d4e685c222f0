// A picture in three dimensions with labels; it is drawn when something has changed.
import {BufferGeometry, Color, CylinderGeometry, DirectionalLight, DoubleSide, Float32BufferAttribute, Group,
  HemisphereLight, Mesh, MeshLambertMaterial, PerspectiveCamera, Plane, Raycaster, Scene, Vector2, Vector3,
  WebGLRenderer} from 'three';
import {OrbitControls} from 'three/examples/jsm/controls/OrbitControls.js';
import {CSS2DObject, CSS2DRenderer} from 'three/examples/jsm/renderers/CSS2DRenderer.js';
import {LineMaterial} from 'three/examples/jsm/lines/LineMaterial.js';
import {LineSegments2} from 'three/examples/jsm/lines/LineSegments2.js';
import {LineSegmentsGeometry} from 'three/examples/jsm/lines/LineSegmentsGeometry.js';

const color = (name) => new Color(getComputedStyle(document.documentElement).getPropertyValue(`--${name}`));

export class Stage {
  constructor(element, eye) {
    const light = new DirectionalLight(0xffffff, 2), camera = new PerspectiveCamera(30, 1, 0.1, 50);
    Object.assign(this, {element, camera, scene: new Scene(), content: new Group()});
    light.position.set(2, -3, 5);
    this.scene.add(new HemisphereLight(0xffffff, 0x8899aa, 2), light, this.content);
    camera.up.set(0, 0, 1);
    camera.position.set(...eye);
    camera.lookAt(0, 0, 0);
    try {
      this.renderer = new WebGLRenderer({antialias: true, alpha: true});
    } catch {
      element.textContent = 'This browser has no WebGL, so there is no picture here.';
      return;
    }
    this.labels = new CSS2DRenderer();
    element.append(this.renderer.domElement, this.labels.domElement);
    this.controls = new OrbitControls(camera, this.renderer.domElement);
    this.controls.enablePan = this.controls.enableZoom = false;
    this.controls.addEventListener('change', () => this.draw());
    new ResizeObserver(() => {
      const {clientWidth: w, clientHeight: h} = element;
      this.renderer.setPixelRatio(devicePixelRatio);
      this.renderer.setSize(w, h);
      this.labels.setSize(w, h);
      Object.assign(camera, {aspect: w / h, zoom: Math.min(1, 0.9 * w / h)});
      camera.updateProjectionMatrix();
      this.draw();
    }).observe(element);
  }

  /** Let a drag turn the picture, or not. */
  orbits(free) {
    if (this.controls) this.controls.enabled = free;
  }

  /** Look at a section from above, and at three axes from where one looked before. */
  look(flat) {
    if (this.flat === flat) return;
    const {camera} = this;
    if (flat) this.eye = camera.position.clone();
    this.flat = flat;
    this.orbits(!flat);
    camera.up.set(0, flat ? 1 : 0, flat ? 0 : 1);
    camera.position.copy(flat ? new Vector3(0, 0, 5) : this.eye ?? camera.position);
    camera.lookAt(0, 0, 0);
  }

  /** Remove everything that `add` and `label` have put here. */
  clear() {
    this.content.traverse((thing) => (thing.geometry?.dispose(), thing.material?.dispose()));
    this.content.clear();
  }

  add(geometry, name, opacity = 1, more = {}) {
    const glass = opacity < 1;
    const mesh = new Mesh(geometry, new MeshLambertMaterial({
      color: color(name), side: DoubleSide, transparent: glass, opacity, depthWrite: !glass, ...more}));
    this.content.add(mesh);
    return mesh;
  }

  /** Add segments, a flat list of their ends. */
  lines(ends, name, linewidth, more = {}) {
    const geometry = new LineSegmentsGeometry().setPositions(ends.flat());
    const line = new LineSegments2(geometry, new LineMaterial({color: color(name), linewidth, ...more}));
    this.content.add(line.computeLineDistances());
  }

  polygons(polygons, name, opacity) {
    const triangles = polygons.flatMap(([first, ...others]) =>
      others.slice(1).flatMap((corner, i) => [first, others[i], corner]));
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new Float32BufferAttribute(triangles.flat(), 3));
    geometry.computeVertexNormals();
    this.add(geometry, name, opacity);
  }

  /** Add a rod from one point to another. */
  rod(from, to, radius, name, top = radius, opacity = 1) {
    const way = to.clone().sub(from);
    const mesh = this.add(new CylinderGeometry(top, radius, way.length(), 24), name, opacity);
    mesh.position.copy(from).addScaledVector(way, 0.5);
    mesh.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), way.normalize());
    return mesh;
  }

  label(text, at, kind) {
    const span = Object.assign(document.createElement('span'), {textContent: text, className: kind});
    const label = new CSS2DObject(span);
    label.position.copy(at);
    this.content.add(label);
  }

  /** Return where a point is on the element [pixels]. */
  project(at) {
    const {x, y} = at.clone().project(this.camera), {clientWidth: w, clientHeight: h} = this.element;
    return new Vector2((x + 1) / 2 * w, (1 - y) / 2 * h);
  }

  ray({clientX, clientY}) {
    const {left, top, width, height} = this.element.getBoundingClientRect(), ray = new Raycaster();
    ray.setFromCamera(new Vector2((clientX - left) / width * 2 - 1, 1 - (clientY - top) / height * 2),
      this.camera);
    return ray;
  }

  /** Return where the pointer is in the plane through a point that faces the camera. */
  under(event, point) {
    const plane = new Plane().setFromNormalAndCoplanarPoint(this.camera.getWorldDirection(new Vector3()),
      point);
    return this.ray(event).ray.intersectPlane(plane, new Vector3());
  }

  draw() {
    if (!this.renderer) return;
    this.frame ??= requestAnimationFrame(() => {
      this.frame = undefined;
      this.renderer.render(this.scene, this.camera);
      this.labels.render(this.scene, this.camera);
    });
  }
}
