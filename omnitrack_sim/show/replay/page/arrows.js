// Arrows of the forces of the wall on the robot.
import {
  Color, ConeGeometry, CylinderGeometry, InstancedMesh, Matrix4, MeshBasicMaterial, Quaternion,
  Vector3,
} from "three";

const UP = new Vector3(0, 1, 0);

export class Arrows {
  constructor(scene, motion, kinds) {
    this.motion = motion;
    this.kinds = kinds;
    this.size = motion.table.robot.scale;
    // Forces are seen through pipes and robot.
    const material = new MeshBasicMaterial({ depthTest: false, depthWrite: false, transparent: true });
    const shaft = new CylinderGeometry(1, 1, 1, 10).translate(0, 0.5, 0);
    const head = new ConeGeometry(1, 1, 14).translate(0, 0.5, 0);
    const count = motion.arrows.length;
    this.meshes = [shaft, head].map((shape) => new InstancedMesh(shape, material, count));
    for (const mesh of this.meshes) {
      mesh.frustumCulled = false;
      mesh.renderOrder = 10;
      scene.add(mesh);
      motion.arrows.forEach(({ kind }, i) => mesh.setColorAt(i, new Color(kinds[kind].colour)));
    }
    this.visible = true;
  }

  /** Draw the forces of now: what the wall pushes with ends at the contact, and what it pulls with
   * begins there. */
  update() {
    for (const mesh of this.meshes) mesh.visible = this.visible;
    if (!this.visible) return;
    const { motion, kinds } = this;
    motion.arrows.forEach(({ kind, at, force }, i) => {
      const { scale: metres, ends } = kinds[kind];
      start.fromArray(at.map((column) => motion.between(column)));
      along.fromArray(force.map((column) => motion.between(column)));
      const length = metres * along.length();
      along.normalize();
      if (ends) start.addScaledVector(along, -length);
      this.draw(i, start, along, length);
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
const [start, along, root, scale] = Array.from({ length: 4 }, () => new Vector3());
const aside = new Quaternion();
const matrix = new Matrix4();
