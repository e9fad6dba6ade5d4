// Three ways to look: around everything, with the robot, out of its nose.
import { Matrix4, PerspectiveCamera, Spherical, Vector3 } from "three";
import { OrbitControls } from "orbit-controls";
import { columnsOf } from "replay/unpack";

export const CAMERAS = ["orbit", "follow", "onboard"];
const STEEPEST = 1.45; // rad, highest view of the camera that follows

export class Cameras {
  constructor(data, bytes, motion, element) {
    const { pipes, follow } = data;
    this.motion = motion;
    this.scale = motion.table.robot.scale;
    this.low = new Vector3(...reduced(pipes.parts, "low", Math.min));
    this.high = new Vector3(...reduced(pipes.parts, "high", Math.max));
    this.back = new Vector3(...pipes.back);
    this.directions = columnsOf(bytes, follow.directions);
    this.distance = follow.distance;
    const far = 20 * this.low.distanceTo(this.high);
    this.outside = new PerspectiveCamera(pipes.fov, 1, 0.01 * this.scale, far);
    this.outside.up.set(0, 0, 1);
    this.onboard = new PerspectiveCamera(data.onboard?.fov ?? pipes.fov, 1, 0.004 * this.scale, far);
    if (data.onboard) {
      const [a, b, c] = data.onboard.frame;
      const axes = new Matrix4().set(...a, 0, ...b, 0, ...c, 0, 0, 0, 0, 1);
      this.mount = axes.setPosition(...data.onboard.position);
    }
    this.onboard.matrixAutoUpdate = false;
    this.controls = new OrbitControls(this.outside, element);
    this.controls.addEventListener("change", () => this.remember());
    this.mode = "orbit";
    this.robot = new Vector3();
    this.turned = { theta: 0, phi: 0, zoom: 1 };
  }

  get camera() {
    return this.mode === "onboard" ? this.onboard : this.outside;
  }

  /** Look in one of CAMERAS, as if nobody had turned anything. */
  choose(mode) {
    this.mode = mode;
    this.turned = { theta: 0, phi: 0, zoom: 1 };
    this.controls.enabled = mode !== "onboard";
    this.controls.enablePan = mode === "orbit";
    if (mode === "orbit") this.showAll();
  }

  resize(width, height) {
    for (const camera of [this.outside, this.onboard]) {
      camera.aspect = width / height;
      camera.updateProjectionMatrix();
    }
    this.width = width;
    if (this.mode === "orbit" && !this.touched) this.showAll();
  }

  /** From where films see all pipes, as near as they fit. */
  showAll() {
    const { outside, low, high, back } = this;
    const middle = low.clone().add(high).multiplyScalar(0.5);
    const half = Math.tan((outside.fov * Math.PI) / 360);
    outside.position.copy(middle).add(back);
    outside.lookAt(middle);
    outside.updateMatrixWorld();
    const toView = outside.matrixWorld.clone().setPosition(0, 0, 0).invert();
    let distance = 0;
    for (let corner = 0; corner < 8; corner++) {
      const point = new Vector3(
        corner & 1 ? low.x : high.x, corner & 2 ? low.y : high.y, corner & 4 ? low.z : high.z,
      ).sub(middle).applyMatrix4(toView);
      const wide = Math.abs(point.x) / (half * outside.aspect);
      distance = Math.max(distance, Math.max(wide, Math.abs(point.y) / half) + point.z);
    }
    outside.position.copy(middle).addScaledVector(back, 1.06 * distance);
    this.controls.target.copy(middle);
    this.controls.update();
    this.touched = false;
  }

  /** Keep with the robot, whose first body is `chassis`, and with the carrier of the camera. */
  update(chassis, carrier) {
    this.robot.copy(chassis.position);
    if (this.mode === "onboard") {
      carrier.updateMatrixWorld();
      this.onboard.matrix.multiplyMatrices(carrier.matrixWorld, this.mount);
      this.onboard.matrix.decompose(
        this.onboard.position, this.onboard.quaternion, this.onboard.scale,
      );
      this.onboard.updateMatrixWorld(true);
    } else if (this.mode === "follow") this.follow();
  }

  base() {
    const direction = new Vector3(...this.directions.map((c) => this.motion.between(c)));
    // Spherical angles of three.js are about y.
    return new Spherical().setFromVector3(new Vector3(direction.y, direction.z, direction.x));
  }

  follow() {
    const base = this.base();
    const phi = Math.min(Math.PI / 2 + STEEPEST, base.phi + this.turned.phi);
    const narrow = Math.max(1, 0.9 / this.outside.aspect);
    const away = new Vector3().setFromSphericalCoords(
      this.distance * narrow * this.turned.zoom,
      Math.max(Math.PI / 2 - STEEPEST, phi),
      base.theta + this.turned.theta,
    );
    this.keeping = true;
    this.controls.target.copy(this.robot);
    this.outside.position.copy(this.robot).add(new Vector3(away.z, away.x, away.y));
    this.controls.update();
    this.outside.updateMatrixWorld();
    this.keeping = false;
  }

  /** What the user has turned, so that it stays while the robot moves on. */
  remember() {
    if (this.mode === "orbit") this.touched = true;
    if (this.mode !== "follow" || this.keeping) return;
    const away = this.outside.position.clone().sub(this.controls.target);
    const base = this.base();
    const now = new Spherical().setFromVector3(new Vector3(away.y, away.z, away.x));
    const narrow = Math.max(1, 0.9 / this.outside.aspect);
    this.turned.theta = now.theta - base.theta;
    this.turned.phi = now.phi - base.phi;
    this.turned.zoom = now.radius / (this.distance * narrow);
  }
}

function reduced(parts, key, choose) {
  return [0, 1, 2].map((i) => parts.map((part) => part[key][i]).reduce((a, b) => choose(a, b)));
}
