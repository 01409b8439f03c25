// Pane (d): the error of every model so far, fitted and held-out, over the noise floor; each can be gone back to.
import { at, el, refill } from "./element.js";
import { plain, times, withUnit } from "./numbers.js";

const MARKS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000]; // times the noise

export class Errors {
  /** does: { goTo(id) }. */
  constructor(store, does) {
    Object.assign(this, { store, does });
    store.on(["entry", "busy", "moved", "shown"], () => this.show());
  }

  show() {
    const { entry } = this.store.now;
    if (!entry?.history?.length) return;
    const scale = this.scale(entry);
    const rows = entry.history.map((state) => this.row(state, entry, scale));
    refill(at("#errors"), [
      el("p", { class: "key" }, el("span", { class: "dot fitted" }), " fitted ", el("span", { class: "dot heldout" }), " on tests left out ", el("span", { class: "floor-key" }), ` noise ${withUnit(entry.noise, entry.units.force)}`),
      el("ol", { class: "states" }, rows, this.inHand(entry, scale)),
      this.ticks(scale)]);
  }

  /** Logarithmic, from a little under the noise to the largest error. */
  scale({ history, noise }) {
    const known = history.flatMap(({ rmse, heldout }) => [rmse, heldout]).filter((error) => error != null);
    if (this.store.now.moved && this.store.now.shown) known.push(this.store.now.shown.rmse);
    const low = Math.min(0.8, ...known.map((error) => 0.9 * (error / noise))), high = Math.max(2, 1.15 * Math.max(...known) / noise);
    return { low, high, noise, share: (ratio) => `${(100 * Math.log(ratio / low)) / Math.log(high / low)}%` };
  }

  row(state, entry, scale) {
    const current = state.id === entry.current && !this.store.now.moved;
    const words = `${named(state)}. ${this.numbers(state, entry)}`;
    return el("li", { "data-key": `state-${state.id}`, class: current ? "current" : "" },
      el("button", { type: "button", "data-act": "go", "aria-current": current ? "step" : null, disabled: Boolean(this.store.now.busy), title: current ? "This model is shown" : "Go back to this model", "aria-label": `${words} ${current ? "Shown." : "Go back to it."}`, onclick: () => this.does.goTo(state.id) },
        el("span", { class: "what" }, el("b", {}, howOf(state)), " ", el("small", {}, modelOf(state))),
        this.line(state, scale),
        el("small", { class: "numbers" }, this.numbers(state, entry))));
  }

  inHand(entry, scale) {
    const { moved, shown } = this.store.now;
    if (!moved || !shown) return null;
    return el("li", { class: "current hand" }, el("span", { class: "what" }, el("b", {}, "in hand")), this.line({ rmse: shown.rmse }, scale),
      el("small", { class: "numbers" }, `error ${withUnit(shown.rmse, entry.units.force)} (${times(shown.rmse / entry.noise)} × noise), not fitted`));
  }

  numbers({ rmse, heldout }, { units, noise }) {
    const left = heldout == null ? "left-out tests: being computed" : `left-out tests ${withUnit(heldout, units.force)} (${times(heldout / noise)} × noise)`;
    return `fitted ${withUnit(rmse, units.force)}, ${left}`;
  }

  line({ rmse, heldout }, { noise, share }) {
    const dot = (error, kind) => error == null ? null : el("span", { class: `dot ${kind}`, "--at": share(error / noise) });
    return el("span", { class: "line-of", "aria-hidden": "true" }, el("span", { class: "floor", "--at": share(1) }), dot(rmse, "fitted"), dot(heldout, "heldout"));
  }

  ticks({ low, high, share }) {
    return el("p", { class: "ticks", "aria-hidden": "true" }, MARKS.filter((mark) => mark >= low && mark <= high).map((mark) => el("span", { "--at": share(mark) }, String(mark))), el("small", {}, "error over noise"));
  }
}

function howOf({ how }) {
  const [verb, ...rest] = how.split(" ");
  const said = { start: "plain model", fit: "fit", kept: "kept by hand", laws: "other laws", add: "+", remove: "−" };
  return [said[verb] || verb, ...rest.map(plain)].join(" ");
}

function modelOf({ elastic, relaxation, effects }) { return [`${elastic}, ${relaxation}`, ...effects.map(plain)].join(" + "); }

const named = (state) => `${howOf(state)}: ${modelOf(state)}`;
