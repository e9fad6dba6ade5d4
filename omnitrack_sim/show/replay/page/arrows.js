// Arrows of the forces of the wall on each module.
import {
  Color, ConeGeometry, CylinderGeometry, InstancedMesh, Matrix4, MeshBasicMaterial, Quaternion,
  Vector3,
} from "three";

export const FORCES = {
  normal_force: { words: "normal force", colour: "#1c2430" },
  traction: { words: "traction", colour: "#d1006c" },
};
const UP = new Vector3(0, 1, 0);

export class Arrows {
  constructor(scene, motion, scales) {
    this.motion = motion;
    this.scales = scales;
    this.size = motion.table.robot.scale;
    const { moved } = motion.table.robot;
    this.modules = moved.flatMap((name, body) => (name.startsWith("module_") ? [body] : []));
    const count = 2 * this.modules.length;
    // Forces are seen through pipes and robot.
    const material = new MeshBasicMaterial({ depthTest: false, depthWrite: false, transparent: true });
    const shaft = new CylinderGeometry(1, 1, 1, 10).translate(0, 0.5, 0);
    const head = new ConeGeometry(1, 1, 14).translate(0, 0.5, 0);
    this.meshes = [shaft, head].map((shape) => new InstancedMesh(shape, material, count));
    for (const mesh of this.meshes) {
      mesh.frustumCulled = false;
      mesh.renderOrder = 10;
      scene.add(mesh);
      for (let i = 0; i < count; i++) {
        const force = Object.values(FORCES)[Math.floor(i / this.modules.length)];
        mesh.setColorAt(i, new Color(force.colour));
      }
    }
    this.visible = true;
  }

  /** Draw the forces of now: what the wall pushes with ends at the contact, and what it pulls with
   * begins there. */
  update() {
    for (const mesh of this.meshes) mesh.visible = this.visible;
    if (!this.visible) return;
    const { motion, modules, scales } = this;
    modules.forEach((body, module) => {
      motion.pose(body, centre, turn);
      contact.fromArray([0, 1, 2].map((i) => motion.value("contact_position", 3 * module + i)));
      ahead.set(0, 0, 1).applyQuaternion(turn);
      inward.copy(centre).sub(contact);
      inward.addScaledVector(ahead, -inward.dot(ahead)).normalize();
      const push = motion.value("normal_force", module) * scales.normal_force;
      this.draw(module, start.copy(contact).addScaledVector(inward, -push), inward, push);
      const pull = motion.value("traction", module) * scales.traction;
      this.draw(modules.length + module, contact, ahead.multiplyScalar(Math.sign(pull)), Math.abs(pull));
    });
    for (const mesh of this.meshes) mesh.instanceMatrix.needsUpdate = true;
  }

  draw(index, from, direction, length) {
    const [shaft, head] = this.meshes;
    const thick = 0.0022 * this.size;
    const tip = Math.min(0.6 * length, 5 * thick);
    if (!(length > thick / 2) || !(direction.lengthSq() > 0.5)) {
      for (const mesh of this.meshes) mesh.setMatrixAt(index, NOTHING);
      return;
    }
    aside.setFromUnitVectors(UP, direction);
    matrix.compose(from, aside, scale.set(thick, length - tip, thick));
    shaft.setMatrixAt(index, matrix);
    root.copy(from).addScaledVector(direction, length - tip);
    matrix.compose(root, aside, scale.set(2.3 * thick, tip, 2.3 * thick));
    head.setMatrixAt(index, matrix);
  }
}

const NOTHING = new Matrix4().makeScale(0, 0, 0);
const [centre, contact, ahead, inward, start, root, scale] = Array.from({ length: 7 }, () => new Vector3());
const [turn, aside] = [new Quaternion(), new Quaternion()];
const matrix = new Matrix4();
