// Force against displacement: the loops of the tests that are shown, and which of their samples are marked.
import { report } from "./report.js";

const { Plot, axes, INK, BLUE, ORANGE } = report;
const NEAR = 24; // pixels from a sample, within which the pointer means it
const FAINT = 0.18; // of the ink of samples that are not marked

export class Loops {
  /** `pointed` is called with the index of the sample that the pointer means, or null. */
  constructor(host, height, pointed) {
    Object.assign(this, { host, height, pointed, plot: null, marked: null, spot: null });
    new ResizeObserver(() => this.fit()).observe(host);
  }

  /** columns: { depth, observed, mean, before } a sample, null between tests; labels: [displacement, force]. */
  show(columns, labels) {
    this.columns = columns;
    this.plot?.destroy();
    const [along, across] = axes(labels[1], null);
    this.plot = new Plot({
      width: this.width(), height: this.height,
      series: [{ label: labels[0] }, { label: labels[1], show: true, paths: () => null, points: { show: false } }],
      axes: [{ ...along, label: labels[0] }, across],
      scales: {
        x: { time: false, range: (u, min, max) => [min, max] },
        y: { range: () => this.reach() },
      },
      legend: { show: false },
      cursor: { drag: { x: false, y: false }, points: { show: false }, x: false, y: false },
      hooks: { draw: [(chart) => this.draw(chart)] },
    }, [this.ends(), [null, null]], this.host);
    this.plot.over.addEventListener("mousemove", (event) => this.hover(event));
    this.plot.over.addEventListener("mouseleave", () => this.pointed(null));
    this.plot.setScale("x", this.wide());
  }

  update(columns) { this.columns = columns; this.plot.setScale("x", this.wide()); }

  /** Which samples are marked: a test of their index, or null for all. */
  mark(marked) { this.marked = marked; this.plot?.redraw(false); }

  point(index) { if (index !== this.spot) { this.spot = index; this.plot?.redraw(false); } }

  ends() {
    const known = this.columns.depth.filter((depth) => depth != null);
    const [low, high] = [Math.min(...known), Math.max(...known)];
    return low < high ? [low, high] : [low - 1, high + 1];
  }

  wide() { const [low, high] = this.ends(), room = 0.03 * (high - low); return { min: low - room, max: high + room }; }

  reach() {
    const known = [...this.columns.observed, ...this.columns.mean].filter((force) => force != null);
    const [low, high] = [Math.min(...known), Math.max(...known)], room = 0.05 * (high - low || 1);
    return [low - room, high + room];
  }

  hover(event) {
    const { depth, observed } = this.columns, box = this.plot.over.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    let best = null, least = NEAR * NEAR;
    depth.forEach((d, k) => {
      if (d == null) return;
      const away = (this.plot.valToPos(d, "x") - x) ** 2 + (this.plot.valToPos(observed[k], "y") - y) ** 2;
      if (away < least) { least = away; best = k; }
    });
    this.pointed(best);
  }

  draw(chart) {
    const { ctx, bbox } = chart, ratio = devicePixelRatio || 1;
    const { depth, observed, mean, before } = this.columns;
    const places = (column) => column.map((force, k) => (force == null ? null : [chart.valToPos(depth[k], "x", true), chart.valToPos(force, "y", true)]));
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    this.dots(ctx, places(observed), ratio);
    if (before) this.trace(ctx, places(before), ORANGE, [6 * ratio, 4 * ratio], ratio);
    this.trace(ctx, places(mean), BLUE, [], ratio);
    if (this.spot != null && depth[this.spot] != null) this.ring(ctx, places(observed)[this.spot], ratio);
    ctx.restore();
  }

  dots(ctx, places, ratio) {
    const size = 2.5 * ratio;
    ctx.fillStyle = INK;
    places.forEach((place, k) => {
      if (!place) return;
      ctx.globalAlpha = !this.marked || this.marked(k) ? 1 : FAINT;
      ctx.fillRect(place[0] - size / 2, place[1] - size / 2, size, size);
    });
    ctx.globalAlpha = 1;
  }

  trace(ctx, places, colour, dash, ratio) {
    ctx.strokeStyle = colour;
    ctx.lineWidth = 1.5 * ratio;
    ctx.setLineDash(dash);
    ctx.beginPath();
    let drawing = false;
    for (const place of places) {
      if (place) ctx[drawing ? "lineTo" : "moveTo"](...place);
      drawing = place != null;
    }
    ctx.stroke();
    ctx.setLineDash([]);
  }

  ring(ctx, [x, y], ratio) {
    ctx.strokeStyle = INK;
    ctx.lineWidth = 2 * ratio;
    ctx.beginPath();
    ctx.arc(x, y, 7 * ratio, 0, 2 * Math.PI);
    ctx.stroke();
  }

  width() { return Math.max(220, Math.floor(this.host.clientWidth)); }

  fit() { if (this.plot && this.host.clientWidth && this.plot.width !== this.width()) this.plot.setSize({ width: this.width(), height: this.height }); }
}
