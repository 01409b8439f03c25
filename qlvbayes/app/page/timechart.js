// One chart against time, force or residual, and the keyboard in it. Knows nothing of what else is on the page.
import { report } from "./report.js";

const { Plot, axes, short } = report;
const KEY = "bench"; // one cursor in all charts against time

export class TimeChart {
  /** hooks: { zoomed(min, max, chart), pointed(index or null, chart) }. */
  constructor(host, height, hooks) {
    Object.assign(this, { host, height, hooks, plot: null });
    new ResizeObserver(() => this.fit()).observe(host);
  }

  /** Draws afresh; lines = { series, values, bands, label } as the report makes them, time first. */
  show(view, lines) {
    const span = this.view === view && this.span ? this.span : view.whole();
    this.view = view;
    this.span = span;
    this.names = namesOf(lines);
    this.plot?.destroy();
    lines.series[0].value = (u, place) => (place == null ? "–" : short(view.moment(place)[1]));
    const [along, across] = axes(lines.label, view.many ? null : view.time);
    this.plot = new Plot({
      width: this.width(), height: this.height, bands: lines.bands, series: lines.series, axes: [view.axis(along), across],
      scales: { x: { time: false, range: (u, min, max) => [min, max] } },
      legend: { live: true, markers: { width: 0, fill: (chart, k) => lines.series[k].mark || lines.series[k].stroke } },
      cursor: { drag: { x: true, y: false }, y: false, sync: { key: KEY } },
      hooks: {
        setScale: [(chart, key) => key === "x" && this.scaled(chart)],
        setCursor: [(chart) => this.hooks.pointed(chart.cursor.left >= 0 ? chart.cursor.idx : null, this)],
        draw: [(chart) => view.drawBorders(chart)],
      },
    }, lines.values, this.host);
    this.plot.root.querySelectorAll(".u-series").forEach((row, k) => { row.hidden = !lines.series[k].label; });
    this.plot.over.addEventListener("dblclick", () => this.zoom(...view.whole()));
    this.zoom(...span);
  }

  /** New numbers for the same lines, or other lines; the zoom stays. */
  update(view, lines) {
    if (this.view !== view || this.names !== namesOf(lines)) return this.show(view, lines);
    this.plot.setData(lines.values, false);
    this.zoom(...this.span);
  }

  zoom(min, max) { this.plot?.setScale("x", { min, max }); }

  scaled(chart) {
    const { min, max } = chart.scales.x;
    if (min == null || chart !== this.plot || (this.span && this.span[0] === min && this.span[1] === max)) return;
    this.span = [min, max];
    this.hooks.zoomed(min, max, this);
  }

  /** Puts the cursor on a sample, or takes it away. */
  point(index) {
    if (!this.plot) return;
    const left = index == null ? -10 : this.plot.valToPos(this.view.x[index], "x");
    this.plot.setCursor({ left, top: index == null ? -10 : 0.5 * this.plot.over.clientHeight });
  }

  width() { return Math.max(240, Math.floor(this.host.clientWidth)); }

  fit() { if (this.plot && this.host.clientWidth && this.plot.width !== this.width()) this.plot.setSize({ width: this.width(), height: this.height }); }
}

const namesOf = (lines) => lines.series.map((series) => series.label).join("|");

const LEAP = 10; // samples with Shift

/** From sample to sample, zoom, all. What is there is read out. */
export function chartKeys(host, { view, spot, point, zoom, span }) {
  /** The next sample within what is shown; the first of it where none is meant yet. */
  const step = (from, by) => {
    const { samples, x } = view(), [min, max] = span();
    const shown = samples.flatMap((sample, k) => (sample && x[k] >= min && x[k] <= max ? [k] : []));
    const place = shown.indexOf(from);
    return shown[place < 0 ? 0 : Math.max(0, Math.min(shown.length - 1, place + by))];
  };
  const about = (factor) => {
    const [min, max] = span(), middle = spot() == null ? 0.5 * (min + max) : view().x[spot()];
    const [low, high] = view().whole(), reach = 0.5 * factor * (max - min);
    zoom(Math.max(low, middle - reach), Math.min(high, middle + reach));
  };
  const does = {
    ArrowLeft: (event) => point(step(spot(), event.shiftKey ? -LEAP : -1)),
    ArrowRight: (event) => point(step(spot(), event.shiftKey ? LEAP : 1)),
    "+": () => about(0.5), "=": () => about(0.5), "-": () => about(2),
    Escape: () => zoom(...view().whole()),
  };
  host.addEventListener("keydown", (event) => {
    if (event.target !== host || !does[event.key] || !view() || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    does[event.key](event);
  });
}
