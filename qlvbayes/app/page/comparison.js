// Two pads next to each other: do they differ, by how much, how sure.
import { at, el, refill } from "./element.js";
import { get } from "./api.js";
import { digits, percent } from "./numbers.js";
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
    const { pads } = this.store.now, choose = () => this.showAnswer();
    [this.first, this.second] = [0, 1].map((n) => el("select", { id: `pad-${n}`, onchange: choose }, pads.map((pad, k) => el("option", { value: pad, selected: k === n }, pad))));
    this.button = el("button", { type: "button", class: "main", onclick: () => this.jobs.start("compare", { pads: this.names() }) }, "Compare them");
    [this.running, this.answer] = [el("div", {}), el("div", {})];
    this.host.replaceChildren(
      el("h2", {}, "Do two pads differ?"),
      el("div", { class: "controls" }, el("label", { for: "pad-0" }, "Pad "), this.first, el("label", { for: "pad-1" }, "against "), this.second, this.button),
      this.running, this.answer);
    const { pad } = this.store.now;
    if (pads.includes(pad)) { this.first.value = pad; this.second.value = pads.find((one) => one !== pad); }
    this.showAnswer();
  }

  names() { return [this.first.value, this.second.value]; }

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
