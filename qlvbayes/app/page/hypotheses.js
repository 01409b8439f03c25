// Pane (c): what may be missing, with probabilities; draw what each would look like, add it, take it out.
import { at, el, refill, say, trying } from "./element.js";
import { RULE } from "./session.js";
import { running } from "./jobs.js";
import { percent, plain, withUnit } from "./numbers.js";
import { post } from "./api.js";

const NOTHING = "none"; // the ranking's name for "nothing is missing"

export class Hypotheses {
  /** does: { add(effect), remove(effect), law(kind, name), draw(effect), diagnose() }. */
  constructor(store, does) {
    Object.assign(this, { store, does, all: false });
    this.hosts = ["search", "laws", "effects"].map((name) => el("div", { class: `part-${name}` }));
    this.drawn = {};
    at("#hypotheses").replaceChildren(...this.hosts);
    store.on(["catalogue", "entry", "hand", "signatures", "busy", "jobs"], () => this.show());
  }

  show() {
    const { catalogue, hand, entry, busy, signatures, pad } = this.store.now;
    if (!catalogue || !hand || !entry) return;
    const searching = running("diagnose", this.store.now);
    this.part(0, [pad, searching, entry.diagnosis, busy], () => this.search(searching));
    this.part(1, [pad, hand.elastic, hand.relaxation, busy, JSON.stringify(lawChances(entry))], () => this.laws());
    this.part(2, [pad, hand.elastic, hand.relaxation, hand.effects, entry.ranking, entry.history, signatures, busy, this.all], () => this.effects());
    if (this.had !== hand.effects.join()) at(".effects", this.hosts[2]).scrollTop = 0; // what was added stands first
    this.had = hand.effects.join();
  }

  /** Draws a part again only if something that it shows has changed: an open list stays open. */
  part(k, facts, draw) {
    if (this.drawn[k] && facts.every((fact, n) => fact === this.drawn[k][n])) return;
    this.drawn[k] = facts;
    refill(this.hosts[k], [draw()].filter(Boolean));
  }

  /** Whether the probabilities are there, and how to get them. */
  search(searching) {
    const { entry, busy } = this.store.now;
    if (searching) return el("p", { class: "hint" }, "Probabilities follow as the search goes on.");
    if (entry.diagnosis) return this.verdict(entry.diagnosis);
    return el("p", { class: "hint", "data-key": "search" }, "No probabilities yet. ",
      el("button", { type: "button", "data-act": "diagnose", disabled: Boolean(busy), onclick: () => this.does.diagnose() }, "Search all hypotheses"));
  }

  verdict(diagnosis) {
    const words = diagnosis.text || [];
    return el("details", { class: "words", "data-key": "verdict", open: true }, el("summary", {}, el("b", {}, `Verdict: ${plain(diagnosis.verdict)}`), diagnosis.effects?.length ? ` (${diagnosis.effects.map(plain).join(", ")})` : ""),
      words.map((text) => el("p", { class: "small" }, text)));
  }

  laws() {
    const { catalogue, hand, busy } = this.store.now;
    const one = (kind) => el("label", {}, `${RULE[kind]} `,
      el("select", { "data-key": kind, "data-act": "choose", disabled: Boolean(busy), onchange: (event) => this.does.law(kind, event.target.value) },
        catalogue[kind].map((law) => el("option", { value: law.name, selected: law.name === hand[kind], title: law.law }, `${law.name}${this.chance(kind, law.name)}`))));
    const about = ["elastic", "relaxation"].map((kind) => catalogue[kind].find((law) => law.name === hand[kind])?.law).filter(Boolean);
    return el("div", { class: "laws" }, one("elastic"), one("relaxation"), el("p", { class: "hint" }, about.join("; ")));
  }

  chance(kind, name) {
    const share = lawChances(this.store.now.entry)[kind]?.[name];
    return share == null ? "" : `, ${percent(share)}`;
  }

  effects() {
    const { catalogue, hand, entry } = this.store.now;
    const ranking = new Map((entry.ranking || []).map((ranked) => [ranked.effect, ranked]));
    const shown = catalogue.effects.filter((effect) => effect.listed || this.all || hand.effects.includes(effect.name));
    const order = (effect) => [hand.effects.includes(effect.name) ? 1 : 0, effect.blind ? -1 : 0, ranking.get(effect.name)?.probability ?? 0];
    const sorted = shown.toSorted((a, b) => compare(order(b), order(a)));
    const none = ranking.get(NOTHING);
    return el("div", {},
      none ? el("p", { class: "hint" }, `Nothing is missing: probability ${percent(none.probability)}.`) : null,
      el("ul", { class: "effects", "aria-label": "Effects" }, sorted.map((effect) => this.effect(effect, ranking.get(effect.name)))),
      el("button", { type: "button", class: "quiet", "data-key": "forms", "aria-pressed": String(this.all), onclick: () => { this.all = !this.all; this.show(); } }, this.all ? "Only the list" : "Other forms too"));
  }

  effect(effect, ranked) {
    const { hand, signatures, busy, entry } = this.store.now;
    const has = hand.effects.includes(effect.name), drawn = signatures.find((one) => one.effect === effect.name);
    const heldout = tried(effect.name, hand, entry.history), name = plain(effect.name);
    const act = (label, does, more) => el("button", { type: "button", "data-act": label, "aria-label": `${label} ${name}`, disabled: Boolean(busy), onclick: does, ...more }, label);
    return el("li", { "data-key": effect.name, class: [has && "has", effect.blind && "blind"].filter(Boolean).join(" ") },
      el("div", { class: "head" },
        el("b", { title: effect.law }, name), has ? el("span", { class: "tag" }, "in the model") : null,
        ranked ? el("span", { class: "chance", "--share": String(ranked.probability), role: "img", "aria-label": `probability ${percent(ranked.probability)}` }, percent(ranked.probability)) : null),
      el("p", { class: "small" }, effect.seen, "."),
      heldout == null ? null : el("p", { class: "small" }, `Error on tests left out with it: ${withUnit(heldout, entry.units.force)}.`),
      effect.blind ? el("p", { class: "small" }, el("i", {}, `These tests cannot show it: ${effect.blind}.`)) : null,
      drawn ? el("p", { class: "small drawn", "--colour": drawn.colour }, drawn.words) : null,
      el("div", { class: "acts" },
        has ? act("Remove", () => this.does.remove(effect.name)) : act("Add", () => this.does.add(effect.name)),
        has || effect.blind ? null : act("Draw it", () => this.does.draw(effect.name), { "aria-pressed": String(Boolean(drawn)) })));
  }
}

/** The held-out error of the last model that was the one in hand with this effect. */
function tried(effect, { elastic, relaxation, effects }, history) {
  const wanted = [...new Set([...effects, effect])].sort().join();
  const found = history.findLast((state) => state.heldout != null && state.elastic === elastic && state.relaxation === relaxation && [...state.effects].sort().join() === wanted);
  return found?.heldout;
}

function compare(a, b) {
  const k = a.findIndex((value, n) => value !== b[n]);
  return k < 0 ? 0 : a[k] - b[k];
}

/** Probabilities of base laws: as reported, or summed over the hypotheses that a diagnosis lists. */
function lawChances({ laws, diagnosis }) {
  if (laws) return laws;
  const summed = { elastic: {}, relaxation: {} };
  for (const { base, probability } of diagnosis?.alternatives || []) {
    for (const kind of Object.keys(summed)) if (base?.[kind]) summed[kind][base[kind]] = (summed[kind][base[kind]] || 0) + probability;
  }
  return summed;
}

// Okabe and Ito's that no other line has, with dashes for readers of a grey copy.
const LOOKS = [{ colour: "#009e73", dash: [8, 3] }, { colour: "#cc79a7", dash: [2, 3] }, { colour: "#e69f00", dash: [8, 3, 2, 3] }];
const REST = 200; // ms after the last move of a slider

/** What effects would look like over the residual, and how much of it they take. */
export class Signatures {
  constructor(session) {
    Object.assign(this, { session, store: session.store });
    this.store.on(["hand"], ({ signatures, hand }) => {
      const left = signatures.filter((one) => !hand?.effects.includes(one.effect));
      if (left.length !== signatures.length) this.store.set({ signatures: left });
      clearTimeout(this.timer);
      if (left.length) this.timer = setTimeout(() => this.again(), REST);
    });
  }

  /** Draws it, or takes it away if it is drawn. Of more than the lines that can be distinguished the first goes. */
  async toggle(effect) {
    const { signatures } = this.store.now;
    if (signatures.some((one) => one.effect === effect)) { this.store.set({ signatures: signatures.filter((one) => one.effect !== effect) }); return; }
    const kept = signatures.slice(-(LOOKS.length - 1));
    const look = LOOKS.find((one) => !kept.some((other) => other.colour === one.colour));
    const drawn = await trying(() => this.ask(effect, look));
    if (!drawn) return;
    this.store.set({ signatures: [...kept, drawn] });
    say(drawn.words);
  }

  async ask(effect, look) {
    const { hand, entry } = this.store.now;
    const found = await post(`${this.session.padPath()}/signature`, { effect, model: hand });
    const { name, value, unit } = found.amplitude;
    const words = `It would take ${percent(found.takes)} of the squared residual (error ${withUnit(found.rmse, entry.units.force)}), with ${name.split(".").pop()} = ${withUnit(value, unit)}.`;
    return { effect, ...look, words, curves: Object.fromEntries(found.tests.map((test) => [test.name, test.with_constants])) };
  }

  /** The model has moved: what is drawn follows. */
  async again() {
    const { signatures, hand } = this.store.now;
    const fresh = await trying(() => Promise.all(signatures.map(({ effect, colour, dash }) => this.ask(effect, { colour, dash }))));
    if (fresh && hand === this.store.now.hand && signatures === this.store.now.signatures) this.store.set({ signatures: fresh });
  }
}
