// What the robot sees ahead: the tile of the moment, of one picture of many.
import { sized } from "replay/words";

const WIDTH = 132; // px

export class RobotPictures {
  constructor(table, drawn) {
    this.table = table;
    this.canvas = document.getElementById("pictures");
    document.getElementById("pictures-box").hidden = false;
    sized(this.canvas, WIDTH, WIDTH);
    this.sheet = new Image();
    this.sheet.onload = drawn;
    this.sheet.src = `data:image/png;base64,${table.png}`;
  }

  /** Number of the last picture at a time, s. */
  at(time) {
    return Math.max(0, this.table.time.findLastIndex((start) => start <= time));
  }

  update(time) {
    const { side, columns } = this.table;
    const number = this.at(time);
    const pen = this.canvas.getContext("2d");
    pen.imageSmoothingEnabled = false;
    const [x, y] = [side * (number % columns), side * Math.floor(number / columns)];
    const { width, height } = this.canvas;
    if (this.sheet.complete) pen.drawImage(this.sheet, x, y, side, side, 0, 0, width, height);
  }
}
