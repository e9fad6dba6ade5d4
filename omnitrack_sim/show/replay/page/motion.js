// A recorded run over time: poses of its bodies and values of its channels.
import { Quaternion, Vector3 } from "three";
import { columnsOf } from "replay/unpack";

export class Motion {
  constructor(table, bytes) {
    this.table = table;
    [this.time] = columnsOf(bytes, table.time);
    this.start = this.time[0];
    this.end = this.time[this.time.length - 1];
    this.positions = columnsOf(bytes, table.robot.positions);
    this.turns = columnsOf(bytes, table.robot.turns);
    this.travel = columnsOf(bytes, table.robot.travel);
    this.arrows = table.arrows.map(({ kind, at, force }) =>
      ({ kind, at: columnsOf(bytes, at), force: columnsOf(bytes, force) }));
    this.curves = {};
    for (const [name, place] of Object.entries(table.curves)) {
      this.curves[name] = columnsOf(bytes, place);
    }
    this.row = 0;
    this.share = 0;
  }

  /** Go to a time: from here on all that is asked for is of then. */
  seek(time) {
    const { time: times } = this;
    let low = 0;
    let high = times.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= time) low = middle;
      else high = middle;
    }
    const length = times[high] - times[low];
    this.row = low;
    this.next = high;
    this.share = length > 0 ? Math.min(1, Math.max(0, (time - times[low]) / length)) : 0;
  }

  /** The value of a column now, between its samples. */
  between(column) {
    return column[this.row] * (1 - this.share) + column[this.next] * this.share;
  }

  /** The value of a column at the nearest sample, for codes. */
  nearest(column) {
    return column[this.share < 0.5 ? this.row : this.next];
  }

  /** A channel's number now. */
  value(name, column = 0) {
    return this.between(this.curves[name][column]);
  }

  /** Put objects, one for each body of the run, where the bodies are now. */
  place(objects) {
    const { bodies, pitch } = this.table.robot;
    let moved = 0;
    for (let i = 0; i < bodies.length; i++) {
      if (bodies[i].on === undefined) this.pose(moved++, objects[i].position, objects[i].quaternion);
      else {
        this.pose(bodies[i].on, objects[i].position, objects[i].quaternion);
        const run = this.between(this.travel[bodies[i].column]);
        const shown = run + pitch / 2 - pitch * Math.floor((run + pitch / 2) / pitch) - pitch / 2;
        along.fromArray(bodies[i].axis).applyQuaternion(objects[i].quaternion);
        objects[i].position.addScaledVector(along, shown);
      }
    }
  }

  /** Pose of a body that moves by itself. */
  pose(body, position, turn) {
    const [x, y, z] = this.positions.slice(3 * body, 3 * body + 3);
    position.set(this.between(x), this.between(y), this.between(z));
    const [w, i, j, k] = this.turns.slice(4 * body, 4 * body + 4);
    const { row, next } = this;
    turn.set(i[row], j[row], k[row], w[row]).normalize();
    turn.slerp(other.set(i[next], j[next], k[next], w[next]).normalize(), this.share);
  }

  /** The span of a list, such as phases, that holds a time. */
  static spanAt(spans, time) {
    return spans.findLast((span) => span.start <= time) ?? spans[0];
  }
}

const along = new Vector3();
const other = new Quaternion();
