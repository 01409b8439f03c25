// Pane (b): error over the noise floor, test by phase. A cell is a button: it zooms the charts and says what is wrong.
import { at, el, refill } from "./element.js";
import { report } from "./report.js";
import { digits, times, withUnit } from "./numbers.js";

const { NAMES } = report;
const DARKEST = 5; // times the noise, from where on a cell is as dark as can be, as in the report

export class ResidualMap {
  constructor(store) {
    this.store = store;
    at("#cell-words").textContent = "";
    store.on(["shown", "cell", "spot", "tests"], () => this.draw());
  }

  draw() {
    const { shown, tests, entry, cell, spot } = this.store.now;
    if (!shown || !tests) return;
    const kinds = Object.keys(NAMES).filter((kind) => shown.cells.some((one) => one.phase === kind));
    const found = new Map(shown.cells.map((one) => [`${one.test}\n${one.phase}`, one]));
    const head = el("tr", {}, el("th", { scope: "col" }, "test"), el("th", { scope: "col", class: "n" }, entry.units.speed), kinds.map((kind) => el("th", { scope: "col", class: "c" }, NAMES[kind])));
    const rows = tests.map((test) => el("tr", {},
      el("th", { scope: "row" }, test.name), el("td", { class: "n" }, digits(test.rate, 3)),
      kinds.map((kind) => this.cell(found.get(`${test.name}\n${kind}`), cell, spot))));
    const caption = el("caption", {}, "Error over noise floor ", el("small", {}, `(${withUnit(entry.noise, entry.units.force)}); 1 is noise, ✗ is beyond it`));
    refill(at("#map"), [el("div", { class: "map wide" }, el("table", {}, caption, el("thead", {}, head), el("tbody", {}, rows)))]);
    this.speak(cell && found.get(`${cell.test}\n${cell.phase}`), [...found.values()]);
  }

  cell(one, chosen, spot) {
    if (!one) return el("td", { class: "c" }, "–");
    const { fails } = one, same = (other) => other && other.test === one.test && other.phase === one.phase;
    const shade = Math.min(Math.max((one.over_noise - 1) / (DARKEST - 1), 0), 1);
    const name = `${NAMES[one.phase]} of ${one.test}: ${times(one.over_noise)} times the noise${fails ? ", beyond noise" : ""}`;
    const button = el("button", { type: "button", "aria-label": name, "aria-pressed": String(Boolean(same(chosen))), onclick: () => this.store.set({ cell: { test: one.test, phase: one.phase } }) },
      times(one.over_noise), fails ? " ✗" : "");
    return el("td", { class: `c cell${fails ? " fails" : ""}${same(spot) ? " meant" : ""}`, "--shade": shade.toFixed(2), "data-key": `${one.test} ${one.phase}` }, button);
  }

  speak(one, all) {
    const line = at("#cell-words");
    const text = one ? one.words : summary(all);
    if (line.textContent !== text) line.textContent = text;
    line.setAttribute("aria-live", this.store.now.moved ? "off" : "polite"); // not at every step of a slider
  }
}

function summary(cells) {
  const many = cells.filter((one) => one.fails).length;
  if (!many) return "No cell is beyond noise.";
  return `${many} of ${cells.length} cells ${many === 1 ? "is" : "are"} beyond noise. Choose one to see what is wrong there.`;
}
