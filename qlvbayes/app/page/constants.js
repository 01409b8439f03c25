// A slider a constant, with its number, unit, and prior or sampled interval; every move is redrawn at once.
import { at, el, refill } from "./element.js";
import { running } from "./jobs.js";
import { digits, withUnit } from "./numbers.js";

const STEPS = 1000; // of a slider
const DIGITS = 4;
const DECADES = 20; // ratio of a slider's ends beyond which it is logarithmic

export class Constants {
  /** does: { move(model), fit(), keep(), undo(), sample() }. */
  constructor(store, does) {
    Object.assign(this, { store, does, rows: new Map() });
    store.on(["parameters"], () => this.build());
    store.on(["entry"], ({ entry }) => this.sampled !== sampledOf(entry) && this.build());
    store.on(["shown", "hand"], () => this.follow());
    store.on(["moved", "busy", "jobs"], () => this.offer());
  }

  build() {
    const { parameters, hand, entry } = this.store.now;
    if (!parameters || !hand) return;
    this.sampled = sampledOf(entry);
    this.rows.clear();
    at("#sliders").replaceChildren(...parameters.map((parameter) => {
      const value = hand.values[parameter.name] ?? parameter.value;
      return this.row(spanned(parameter, value, this.sampled?.[parameter.name]), value);
    }));
    this.offer();
  }

  row(parameter, value) {
    const { name, unit, meaning, low, high, derived, owner, likely, about } = parameter;
    const id = `constant-${name}`, range = `${id}-about`;
    const box = el("input", { type: "text", inputmode: "decimal", class: "number", id: `${id}-number`, value: digits(value, DIGITS), readonly: derived, "aria-label": `${name} in ${unit}`, "aria-describedby": range, onchange: (event) => this.typed(parameter, event.target), "data-act": "number" });
    const slider = derived ? null : el("input", { type: "range", id, min: 0, max: STEPS, step: 1, value: toSlider(parameter, value), "aria-label": `${name}, ${meaning}`, "aria-valuetext": withUnit(value, unit, DIGITS), "data-act": "slide", oninput: (event) => this.move(parameter, fromSlider(parameter, +event.target.value)) });
    const wrong = el("p", { class: "wrong", role: "alert", hidden: true });
    this.rows.set(name, { parameter, box, slider, wrong });
    const share = (edge) => `${(100 * toSlider(parameter, edge)) / STEPS}%`;
    return el("div", { class: "constant", "data-key": name },
      el("label", { for: derived ? box.id : id, title: `${meaning} (${owner})` }, el("b", {}, breakable(name))),
      el("span", { class: "entry" }, box, " ", el("span", { class: "unit" }, unit === "1" ? "" : unit)),
      slider ? el("span", { class: "track", "--from": share(likely[0]), "--to": share(likely[1]), title: `slider: ${digits(low, 3)} to ${withUnit(high, unit)}` }, slider) : null,
      el("small", {}, name.includes(".") ? "" : meaning), el("small", { id: range, class: "range" }, about), wrong);
  }

  typed(parameter, box) {
    const { wrong } = this.rows.get(parameter.name), { name, unit, widest: [low, high] } = parameter;
    const value = Number(box.value.trim().replace("−", "-").replace(",", "."));
    const bad = box.value.trim() === "" || !Number.isFinite(value) ? `${name}: write a number.`
      : value < low || value > high ? `${name} goes from ${digits(low, 3)} to ${withUnit(high, unit)}.` : "";
    wrong.textContent = bad;
    wrong.hidden = !bad;
    box.setAttribute("aria-invalid", String(Boolean(bad)));
    if (!bad) this.move(parameter, value);
  }

  move({ name }, value) {
    const { hand, parameters } = this.store.now;
    const free = parameters.filter((one) => !one.derived).map((one) => [one.name, hand.values[one.name] ?? one.value]);
    this.does.move({ ...hand, values: { ...Object.fromEntries(free), [name]: value } });
  }

  /** Numbers and sliders go where the model in hand is, and what is derived where the last answer says. */
  follow() {
    const { hand, shown } = this.store.now;
    if (!hand) return;
    for (const [name, { parameter, box, slider, wrong }] of this.rows) {
      const value = (parameter.derived ? shown?.values?.[name] : hand.values[name]) ?? parameter.value;
      if (box.getAttribute("aria-invalid") === "true" && box === document.activeElement) continue;
      box.value = digits(value, DIGITS);
      box.removeAttribute("aria-invalid");
      wrong.hidden = true;
      if (!slider) continue;
      if (fromSlider(parameter, +slider.value) !== value) slider.value = toSlider(parameter, value);
      slider.setAttribute("aria-valuetext", withUnit(value, parameter.unit, DIGITS));
    }
  }

  offer() {
    const { moved, busy, parameters } = this.store.now;
    if (!parameters) return;
    const act = (key, label, does, off, title) => el("button", { type: "button", "data-key": key, disabled: Boolean(busy) || off, title, onclick: does }, label);
    refill(at("#acts"), [
      act("fit", "Fit from here", () => this.does.fit(), false, "Least squares from where the sliders are"),
      act("keep", "Keep as it is", () => this.does.keep(), !moved, "Note this model among the errors, without a fit"),
      act("undo", "Put back", () => this.does.undo(), !moved, "The constants as they were before the sliders moved"),
      act("sample", "Sample", () => this.does.sample(), running("sample", this.store.now), "All constants with their uncertainty, by emcee; the band appears when it is good")]);
  }
}

/** The posterior of the constants, if the state that is shown is the one that was sampled well. */
function sampledOf(entry) {
  const bands = entry?.bands;
  return bands?.converged && bands.state === entry.current ? bands.summary.parameters : null;
}

/** The slider's ends and what is likely on it: the prior, or once sampled the interval with its own width on either side. */
function spanned(parameter, value, posterior) {
  const { low, high, prior, derived } = parameter, widest = [low, high];
  const text = (ends, many) => ends.map((end) => digits(end, many)).join(" to ");
  if (!posterior) return { ...parameter, widest, likely: prior, about: derived ? "follows from the others" : `prior ${text(prior, 2)}` };
  const [from, to] = posterior.hdi90, room = to - from || Math.abs(to) || 1;
  const ends = [Math.min(value, Math.max(low, from - room)), Math.max(value, Math.min(high, to + room))];
  return { ...parameter, widest, low: ends[0], high: ends[1], log: parameter.log && ends[0] > 0 && ends[1] / ends[0] > DECADES, likely: [from, to], about: `90 %: ${text([from, to], DIGITS)}` };
}

/** A long name may go on in the next line after its dots and underscores. */
function breakable(name) { return name.includes(".") ? name.split(/(?<=[._])/).flatMap((part, k) => (k ? [el("wbr"), part] : [part])) : [name]; }

function toSlider({ low, high, log }, value) {
  const share = log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
  return Math.round(STEPS * Math.min(Math.max(share, 0), 1));
}

function fromSlider({ low, high, log }, place) {
  const share = place / STEPS;
  return log ? low * (high / low) ** share : low + share * (high - low);
}
