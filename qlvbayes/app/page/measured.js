// Pane (a): force and residual against time, force against displacement; what is meant in one is marked in all.
import { at, el } from "./element.js";
import { report } from "./report.js";
import { View } from "./view.js";
import { TimeChart, chartKeys } from "./timechart.js";
import { Loops } from "./loops.js";
import { axisLabel, columnsOf, linesOf } from "./lines.js";
import { short, times, withUnit } from "./numbers.js";

const { NAMES, isFast } = report;
const ALL = "all tests";
const ROOM = 0.08; // of a phase, shown on either side of it

export class Measured {
  constructor(store) {
    this.store = store;
    this.scale = null; // until the reader chooses: logarithmic where a phase is too short to be seen
    const hooks = { zoomed: (...span) => this.zoomed(...span), pointed: (k, chart) => this.pointed(k, chart) };
    this.force = new TimeChart(at("#force"), 250, hooks);
    this.residual = new TimeChart(at("#residual"), 200, hooks);
    this.loops = new Loops(at("#loops"), 230, (k) => this.pointed(k, this.loops));
    for (const chart of [this.force, this.residual]) {
      chartKeys(chart.host, {
        view: () => this.view, spot: () => this.spot, span: () => this.force.span,
        point: (k) => { at("#readout").setAttribute("aria-live", "polite"); this.pointed(k, null); },
        zoom: (min, max) => this.force.zoom(min, max),
      });
      chart.host.addEventListener("pointermove", () => at("#readout").setAttribute("aria-live", "off"));
    }
    store.on(["tests"], () => this.offer());
    store.on(["shown", "before", "signatures", "entry", "moved"], () => this.update());
    store.on(["cell"], ({ cell }) => cell && this.toCell(cell));
  }

  /** The tests to choose from, for a pad that was just opened. */
  offer() {
    const { tests, entry } = this.store.now;
    const rate = (test) => (test.rate == null ? "" : `, ${withUnit(test.rate, entry.units.speed)}`);
    this.select = el("select", { id: "test", onchange: () => this.choose() },
      tests.length > 1 ? el("option", { value: ALL }, ALL) : null, tests.map((test) => el("option", { value: test.name }, `${test.name}${rate(test)}`)));
    this.buttons = el("span", { class: "phases", role: "group", "aria-label": "Part of the test" });
    this.scales = ["logarithmic", "linear"].map((name) =>
      el("button", { type: "button", value: name.slice(0, 3), onclick: () => { this.scale = name.slice(0, 3); this.choose(); } }, name));
    at("#measured-controls").replaceChildren(el("label", { for: "test" }, "Test "), this.select, this.buttons,
      el("span", { class: "scale", role: "group", "aria-label": "Time axis" }, "Time ", this.scales));
    this.view = null;
  }

  chosen() { return this.store.now.tests.filter((test) => this.select.value === ALL || test.name === this.select.value); }

  /** Shows the test that is chosen. */
  choose() {
    const tests = this.chosen();
    const scale = this.scale || (isFast(tests[0]) ? "log" : "lin");
    this.view = new View(tests, scale);
    this.spot = null;
    for (const button of this.scales) {
      button.setAttribute("aria-pressed", String(this.view.many ? button.value === "log" : button.value === scale));
      button.disabled = this.view.many;
    }
    this.offerPhases(tests);
    this.redraw(true);
  }

  offerPhases(tests) {
    const choices = [["whole", () => this.force.zoom(...this.view.whole())]];
    if (tests.length === 1) for (const { name, span } of phasesOf(tests[0])) choices.push([name, () => this.zoomTo(...span)]);
    this.buttons.replaceChildren(...choices.map(([name, go]) => el("button", { type: "button", onclick: go }, name)));
  }

  /** Times (s) of the one test shown, with some room on either side as the axis has it. */
  zoomTo(start, stop) { this.force.zoom(...this.roomy(start, stop)); }

  roomy(start, stop) {
    const [first, last] = [start, stop].map((time) => this.view.place(0, time)), room = ROOM * (last - first);
    return [first - room, last + room];
  }

  toCell({ test, phase }) {
    this.select.value = test;
    this.choose();
    const spans = this.chosen()[0].phases.filter(([kind]) => kind === phase);
    const [first, last] = [spans[0], spans[spans.length - 1]];
    this.zoomTo(first[1], last[2]);
  }

  update() {
    const { shown, tests } = this.store.now;
    if (!shown || !tests || !this.select) return;
    if (this.view) this.redraw(false);
    else this.choose();
  }

  redraw(afresh) {
    const { now } = this.store;
    if (!now.shown) return;
    this.columns = columnsOf(now, this.view);
    const lines = linesOf(now, this.view, this.columns);
    for (const name of ["force", "residual"]) {
      if (afresh) this[name].show(this.view, lines[name]);
      else this[name].update(this.view, lines[name]);
    }
    if (!afresh) { this.loops.update(this.columns); return; }
    this.loops.show(this.columns, [axisLabel(now.entry.units, "displacement"), axisLabel(now.entry.units, "force")]);
    this.zoomed(...this.force.span, null);
  }

  /** Time was zoomed in one chart: the other follows, and the loops mark the same samples. */
  zoomed(min, max, from) {
    for (const chart of [this.force, this.residual]) if (chart !== from && chart.view === this.view) chart.zoom(min, max);
    const [low, high] = this.view.whole(), all = min <= low && max >= high;
    this.loops.mark(all ? null : (k) => this.view.x[k] >= min && this.view.x[k] <= max);
    Object.assign(at("#force").dataset, { min, max });
    this.pressPhase(min, max);
  }

  pressPhase(min, max) {
    const near = (a, b) => Math.abs(a - b) < 1e-6 * (1 + Math.abs(b));
    const spans = [this.view.whole(), ...(this.view.many ? [] : phasesOf(this.view.tests[0]).map(({ span }) => this.roomy(...span)))];
    [...this.buttons.children].forEach((button, k) => button.setAttribute("aria-pressed", String(near(spans[k][0], min) && near(spans[k][1], max))));
  }

  /** A sample is meant: the same one is marked everywhere and read out. */
  pointed(index, from) {
    if (this.pointing || !this.view || index === this.spot) return;
    if (index != null && !this.view.samples[index]) return;
    this.pointing = true;
    this.spot = index;
    if (from !== this.force && from !== this.residual) for (const chart of [this.force, this.residual]) chart.point(index);
    this.loops.point(index);
    this.readOut(index);
    this.pointing = false;
  }

  readOut(index) {
    if (index == null) { at("#readout").textContent = "\u00a0"; this.store.set({ spot: null }); return; }
    const [n, k] = this.view.samples[index], test = this.view.tests[n], { units, noise } = this.store.now.entry;
    const phase = test.phase[k], residual = this.columns.observed[index] - this.columns.mean[index];
    at("#readout").textContent = `${test.name}, ${NAMES[phase] || phase}, ${short(test.t[k])} s, ${withUnit(test.d[k], units.displacement)}: measured ` +
      `${withUnit(test.observed[k], units.force)}, model ${withUnit(this.columns.mean[index], units.force)}, ` +
      `residual ${withUnit(residual, units.force, 2)} (${times(Math.abs(residual) / noise)} × noise)`;
    const { spot } = this.store.now;
    if (spot?.test !== test.name || spot?.phase !== phase) this.store.set({ spot: { test: test.name, phase } });
  }
}

/** The phases of a test with their spans; several of a kind are numbered. */
function phasesOf(test) {
  const many = {}, seen = {};
  for (const [kind] of test.phases) many[kind] = (many[kind] || 0) + 1;
  return test.phases.map(([kind, start, stop]) => {
    seen[kind] = (seen[kind] || 0) + 1;
    const name = NAMES[kind] || kind;
    return { name: many[kind] > 1 ? `${name} ${seen[kind]}` : name, span: [start, stop] };
  });
}
