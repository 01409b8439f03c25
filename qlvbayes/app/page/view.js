// The samples that the charts show, and where on the axis of time each stands: one test, or all side by side.
import { report } from "./report.js";

const { LogTime, GREY } = report;
const LETTER = 7; // pixels of a letter on an axis

/** Places of all tests on one axis: a stretch a phase, as the report draws one test. */
class SideBySide extends LogTime {
  constructor(tests) {
    super({ phases: [], t: [] });
    this.times = tests.map((test) => new LogTime(test));
    this.parts = this.times.flatMap((time) => time.parts);
    this.firsts = this.times.map((_, n) => this.times.slice(0, n).reduce((sum, time) => sum + time.parts.length, 0));
  }
}

export class View {
  /** tests: [{ name, t, phases, ... }]; scale: "log" or "linear" (of one test). */
  constructor(tests, scale) {
    this.tests = tests;
    this.many = tests.length > 1;
    this.time = this.many ? new SideBySide(tests) : scale === "log" ? new LogTime(tests[0]) : null;
    this.samples = [];
    this.x = [];
    tests.forEach((test, n) => {
      if (n) this.put(null, this.place(n, -Infinity));
      test.t.forEach((time, k) => this.put([n, k], this.place(n, time)));
    });
  }

  put(sample, place) { this.samples.push(sample); this.x.push(place); }

  place(n, time) {
    if (this.many) return this.time.firsts[n] + (time === -Infinity ? 0 : this.time.times[n].to(time));
    return this.time ? this.time.to(time) : time;
  }

  /** Which test and time (s) stand at a place. */
  moment(place) {
    if (!this.many) return [0, this.time ? this.time.from(place) : place];
    const n = this.time.firsts.findLastIndex((first) => place >= first);
    return [Math.max(n, 0), this.time.times[Math.max(n, 0)].from(place - this.time.firsts[Math.max(n, 0)])];
  }

  whole() { return [this.x[0], this.many ? this.time.parts.length : this.x[this.x.length - 1]]; }

  /** A number a sample, from a column of numbers a test; null between tests. */
  gather(column) {
    const columns = this.tests.map(column);
    return this.samples.map((sample) => (sample && columns[sample[0]] ? columns[sample[0]][sample[1]] : null));
  }

  /** Changes the report's axis of time where several tests share it. */
  axis(along) {
    if (!this.many) return along;
    const { firsts, times } = this.time;
    const middle = (n) => firsts[n] + 0.5 * times[n].parts.length;
    return {
      ...along, label: "tests side by side, time logarithmic",
      splits: (chart) => this.named(chart.bbox.width / (devicePixelRatio || 1)).map(middle),
      values: (chart) => this.named(chart.bbox.width / (devicePixelRatio || 1)).map((n) => this.tests[n].name),
      grid: { show: false },
    };
  }

  /** Numbers of the tests whose names have room on so many pixels. */
  named(width) {
    const longest = Math.max(...this.tests.map((test) => test.name.length));
    const step = Math.ceil((this.tests.length * LETTER * (longest + 2)) / width);
    return this.tests.map((_, n) => n).filter((n) => n % step === 0);
  }

  /** Solid lines between tests. */
  drawBorders(chart) {
    if (this.time) report.borders(chart, this.time);
    if (!this.many) return;
    const { ctx, bbox } = chart;
    ctx.save();
    ctx.strokeStyle = GREY;
    ctx.lineWidth = 2 * (devicePixelRatio || 1);
    for (const first of this.time.firsts.slice(1)) {
      const x = chart.valToPos(first, "x", true);
      if (x > bbox.left && x < bbox.left + bbox.width) { ctx.beginPath(); ctx.moveTo(x, bbox.top); ctx.lineTo(x, bbox.top + bbox.height); ctx.stroke(); }
    }
    ctx.restore();
  }
}
