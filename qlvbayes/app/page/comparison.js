// Two pads next to each other: do they differ, by how much, how sure; and their curves in one chart.
import { at, el, refill } from "./element.js";
import { get } from "./api.js";
import { Overlay, partner, sideOf } from "./overlay.js";
import { digits, percent, withUnit } from "./numbers.js";
import { trying } from "./say.js";

const ANSWERS = { equal: ["equal", "equal"], greater: ["greater", "differs"], less: ["less", "differs"], "cannot tell": ["cannot tell", "open"] };

export class ComparisonView {
  constructor(session, jobs) {
    Object.assign(this, { session, jobs, store: session.store, host: at("#comparison") });
    this.store.on(["entries", "view"], ({ view }) => view === "compare" && this.showAnswer());
    this.store.on(["jobs"], ({ view }) => view === "compare" && this.progress());
  }

  /** Built when it is first looked at. */
  open() {
    if (this.host.childElementCount) return;
    const { pads } = this.store.now, choose = () => this.draw();
    [this.first, this.second] = [0, 1].map((n) => el("select", { id: `pad-${n}`, onchange: choose }, pads.map((pad, k) => el("option", { value: pad, selected: k === n }, pad))));
    this.test = el("select", { id: "overlay-test", onchange: () => this.overlay() });
    this.button = el("button", { type: "button", class: "main", onclick: () => this.jobs.start("compare", { pads: this.names() }) }, "Compare them");
    const chart = el("div", { class: "chart", role: "img", "aria-label": "Force against time of both pads, measured and modelled" });
    [this.note, this.running, this.answer] = [el("p", { class: "hint" }), el("div", {}), el("div", {})];
    this.host.replaceChildren(
      el("h2", {}, "Do two pads differ?"),
      el("div", { class: "controls" }, el("label", { for: "pad-0" }, "Pad "), this.first, el("label", { for: "pad-1" }, "against "), this.second, el("label", { for: "overlay-test" }, "in "), this.test, this.button),
      this.running, chart, this.note, this.answer);
    this.chart = new Overlay(chart);
    const { pad } = this.store.now;
    if (pads.includes(pad)) { this.first.value = pad; this.second.value = pads.find((one) => one !== pad); }
    this.draw();
  }

  names() { return [this.first.value, this.second.value]; }

  async draw() {
    const names = this.names();
    this.showAnswer();
    this.note.textContent = `Opening pads ${names.join(" and ")} …`;
    const sides = await trying(() => Promise.all(names.map((pad) => sideOf(this.session, pad))));
    if (!sides || names.join() !== this.names().join()) return;
    this.sides = sides;
    this.test.replaceChildren(...sides[0].tests.map((test) => el("option", { value: test.name }, test.rate == null ? test.name : withUnit(test.rate, sides[0].entry.units.speed))));
    this.overlay();
  }

  overlay() {
    const test = this.sides[0].tests.find((one) => one.name === this.test.value), other = partner(test, this.sides[1].tests);
    this.note.textContent = other ? `${test.name} next to ${other.name}. Dots are measured, lines are each pad's current model; drag to zoom.` : `Pad ${this.sides[1].pad} has no test at this rate.`;
    if (other) this.chart.show(this.sides, [test, other]);
  }

  progress() {
    if (!this.running) return;
    refill(this.running, this.store.now.jobs.filter((job) => job.kind === "compare").map((job) => this.jobs.row(job)));
  }

  /** The contrasts, if they were computed. */
  async showAnswer() {
    if (!this.answer) return;
    const names = this.names(), answer = await trying(() => get(`${this.session.path}/comparison`));
    const found = answer?.comparisons.find((one) => names.every((name) => one.names.includes(name)));
    this.button.disabled = names[0] === names[1];
    this.answer.replaceChildren(...(found ? [...found.words.map((text) => el("p", {}, text)), contrasts(found)]
      : [el("p", { class: "undone" }, names[0] === names[1] ? "Choose two different pads." : "Not compared yet. Comparing samples both pads first; that takes some minutes and can be cancelled.")]));
  }
}

function contrasts({ names, contrasts: rows }) {
  const interval = (value) => (value ? `${digits(value.median, 3)} (${digits(value.low, 3)} to ${digits(value.high, 3)})` : "–");
  const row = (one) => {
    const [text, look] = ANSWERS[one.answer] || [one.answer, "open"];
    return el("tr", {}, el("th", { scope: "row" }, one.quantity), el("td", {}, one.unit === "1" ? "" : one.unit),
      [one.first, one.second, one.difference, one.ratio].map((value) => el("td", { class: "n" }, interval(value))),
      el("td", { class: "n" }, percent(one.direction)), el("td", { class: `answer ${look}` }, text, one.extrapolated ? " (beyond the tests)" : ""));
  };
  const heads = ["quantity", "unit", names[0], names[1], `${names[0]} − ${names[1]}`, `${names[0]} / ${names[1]}`, `P(${names[0]} > ${names[1]})`, "answer"];
  return el("div", { class: "wide", tabindex: "0" }, el("table", {}, el("caption", {}, "Median and 90 % interval"),
    el("thead", {}, el("tr", {}, heads.map((text, k) => el("th", { scope: "col", class: k > 1 && k < 7 ? "n" : "" }, text)))), el("tbody", {}, rows.map(row))));
}
