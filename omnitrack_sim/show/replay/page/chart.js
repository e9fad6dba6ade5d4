// The map of the pipes that the robot knows so far: its way, the robot and its goals.
import { Quaternion, Vector3 } from "three";
import { columnsOf } from "replay/unpack";
import { sized } from "replay/words";

const PAD = 10; // px around the pipes

export class Chart {
  constructor(map, motion, bytes) {
    this.map = map;
    this.aheads = columnsOf(bytes, map.ahead);
    [this.backward] = columnsOf(bytes, map.backward);
    this.motion = motion;
    this.canvas = document.getElementById("map");
    this.picture = document.createElement("canvas");
    this.canvas.hidden = false;
    const points = map.pieces.flatMap((piece) => piece.ends);
    const widest = Math.max(...map.pieces.map((piece) => piece.radius));
    this.low = [0, 1].map((i) => points.reduce((m, p) => Math.min(m, p[i]), Infinity) - widest);
    this.high = [0, 1].map((i) => points.reduce((m, p) => Math.max(m, p[i]), -Infinity) + widest);
    const [xs, ys, zs] = motion.positions;
    this.way = Array.from(motion.time, (_, row) => this.flat([xs[row], ys[row], zs[row]]));
  }

  flat(point) {
    return this.map.view.map((axis) => axis[0] * point[0] + axis[1] * point[1] + axis[2] * point[2]);
  }

  pixel([x, y]) {
    return [PAD + this.scale * (x - this.low[0]), PAD + this.scale * (this.high[1] - y)];
  }

  /** Fit the map into a corner of a view of this size. */
  resize(width, height) {
    const [wide, high] = [0, 1].map((i) => this.high[i] - this.low[i]);
    const room = [Math.min(300, 0.34 * width) - 2 * PAD, Math.min(260, 0.4 * height) - 2 * PAD];
    this.scale = Math.min(room[0] / wide, room[1] / high);
    const size = [this.scale * wide + 2 * PAD, this.scale * high + 2 * PAD];
    this.canvas.style.width = `${size[0]}px`;
    this.ratio = sized(this.canvas, ...size);
    this.picture.width = this.canvas.width;
    this.picture.height = this.canvas.height;
    this.paint();
  }

  /** Of pieces, plates or goals those that the robot has discovered by now. */
  known(things) {
    const { motion } = this;
    return things.filter((thing) => thing.from <= (motion.share < 0.5 ? motion.row : motion.next));
  }

  /** How many of them these are, which changes whenever the map has to be painted anew. */
  count() {
    const { pieces, plates, goals } = this.map;
    return [pieces, plates, goals].reduce((sum, things) => sum + this.known(things).length, 0);
  }

  paint() {
    const { map, ratio } = this;
    const pen = this.picture.getContext("2d");
    this.painted = this.count();
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, this.picture.width, this.picture.height);
    pen.lineCap = "round";
    for (const { radius, ends } of this.known(map.pieces)) {
      const thick = Math.max(4, 2 * radius * this.scale);
      // The pale edge ends square, so that it shows at crossings and not where pieces meet.
      for (const [cap, width, colour] of [["butt", thick + 3, "#fff"], ["round", thick, "#b4bdc8"]]) {
        pen.lineCap = cap;
        pen.lineWidth = width;
        pen.strokeStyle = colour;
        this.path(pen, ends);
        pen.stroke();
      }
    }
    pen.fillStyle = "#c8322b";
    for (const { rim } of this.known(map.plates)) {
      this.path(pen, rim);
      pen.fill();
      pen.lineWidth = 3;
      pen.strokeStyle = "#c8322b";
      pen.stroke();
    }
    for (const { point } of this.known(map.goals)) this.star(pen, this.pixel(point));
  }

  path(pen, points) {
    pen.beginPath();
    points.forEach((point, i) => pen[i ? "lineTo" : "moveTo"](...this.pixel(point)));
  }

  star(pen, [x, y]) {
    pen.beginPath();
    for (let i = 0; i < 10; i++) {
      const [reach, angle] = [i % 2 ? 3.2 : 7.5, (Math.PI * i) / 5];
      pen[i ? "lineTo" : "moveTo"](x + reach * Math.sin(angle), y - reach * Math.cos(angle));
    }
    pen.closePath();
    pen.fillStyle = "#ffd34d";
    pen.fill();
    pen.lineWidth = 1;
    pen.strokeStyle = "#5f4a00";
    pen.stroke();
  }

  update() {
    const { canvas, ratio, motion } = this;
    if (this.painted !== this.count()) this.paint();
    const pen = canvas.getContext("2d");
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.drawImage(this.picture, 0, 0);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.trail(pen);
    motion.pose(0, place, turn);
    const [x, y] = this.pixel(this.flat(place.toArray()));
    nose.fromArray(this.aheads.map((column) => motion.between(column))).normalize();
    const ahead = this.flat(nose.toArray());
    pen.fillStyle = "#22262b";
    pen.strokeStyle = "#fff";
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(x + 14 * ahead[0], y - 14 * ahead[1]);
    pen.lineTo(x - 4 * ahead[1], y - 4 * ahead[0]);
    pen.lineTo(x + 4 * ahead[1], y + 4 * ahead[0]);
    pen.fill();
    pen.beginPath();
    pen.arc(x, y, 5, 0, 2 * Math.PI);
    pen.fill();
    pen.stroke();
    this.believed(pen);
  }

  /** A ring where the robot takes itself to be, where that is not where it is. */
  believed(pen) {
    this.mark = this.motion.curves.position_estimate?.map((column) => this.motion.between(column));
    if (!this.mark) return;
    if (!(place.distanceTo(believed.fromArray(this.mark)) > this.map.beside)) return;
    const [left, top] = this.pixel(this.flat(this.mark));
    for (const [width, colour] of [[4.5, "#fff"], [2.2, "#0a84c6"]]) {
      pen.lineWidth = width;
      pen.strokeStyle = colour;
      pen.beginPath();
      pen.arc(left, top, 8, 0, 2 * Math.PI);
      pen.stroke();
    }
  }

  trail(pen) {
    const { motion, way, backward } = this;
    pen.lineWidth = 2.4;
    pen.lineJoin = "round";
    let begun = null;
    const step = Math.max(1, Math.floor(way.length / 1500));
    for (let row = 0; row <= motion.row; row += step) {
      if (backward[row] !== begun) {
        if (begun !== null) pen.stroke();
        begun = backward[row];
        pen.strokeStyle = WAYS[begun];
        pen.beginPath();
      }
      pen.lineTo(...this.pixel(way[row]));
    }
    pen.stroke();
  }
}

const WAYS = ["#c77700", "#b0246e"]; // nose first, tail first
const place = new Vector3();
const believed = new Vector3();
const nose = new Vector3();
const turn = new Quaternion();
