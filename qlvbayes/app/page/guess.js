// Guess first: the ranking stays hidden until the reader has written down what may be missing.
import { at, el } from "./element.js";
import { post } from "./api.js";
import { plain } from "./numbers.js";
import { say, trying } from "./say.js";

const NOTHING = "";

export class Guess {
  constructor(session) {
    Object.assign(this, { session, store: session.store, shown: null });
    this.store.on(["guess", "catalogue"], () => this.show());
  }

  show() {
    const { guess, catalogue } = this.store.now, host = at("#guess");
    const facts = JSON.stringify([guess, catalogue?.effects.length]);
    if (facts === this.shown) return; // what is being written stays
    this.shown = facts;
    if (!guess || !catalogue) host.replaceChildren();
    else host.replaceChildren(guess.given ? this.answer(guess) : this.form(catalogue));
  }

  form({ effects }) {
    const listed = effects.filter((effect) => effect.listed).toSorted((a, b) => a.name.localeCompare(b.name));
    const choice = (id, label, first) => el("label", {}, `${label} `, el("select", { id },
      el("option", { value: NOTHING }, first), listed.map((effect) => el("option", { value: effect.name, title: effect.seen }, plain(effect.name)))));
    return el("form", { class: "guess", onsubmit: (event) => { event.preventDefault(); this.send(); } },
      el("p", { class: "line" }, "What is missing? Guess before you see the ranking."),
      el("p", { class: "hint" }, "Look at the failing cells, draw signatures over the residual, then write it down."),
      el("div", { class: "controls" }, choice("guess-one", "I think it is", "nothing"), choice("guess-two", "and", "nothing else")),
      el("label", {}, "Because ", el("textarea", { id: "guess-words", rows: "2", placeholder: "What do you see, and where?" })),
      el("button", { type: "submit", class: "main" }, "Write it down"));
  }

  async send() {
    const effects = [...new Set(["#guess-one", "#guess-two"].map((id) => at(id).value).filter((name) => name !== NOTHING))];
    const found = await trying(() => post(`${this.session.path}/guess`, { effects, words: at("#guess-words").value.trim() }));
    if (!found) return;
    this.store.set({ guess: found.guess });
    say(at("#guess").textContent);
    await trying(() => this.session.refresh());
  }

  answer({ given, truth }) {
    const list = (effects) => (effects.length ? effects.map(plain).join(" and ") : "nothing");
    const right = truth && list([...truth.effects].sort()) === list([...given.effects].sort());
    return el("div", { class: `guessed ${truth ? (right ? "right" : "other") : ""}` },
      el("p", {}, "You guessed: ", el("b", {}, list(given.effects)), given.words ? ` (“${given.words}”)` : ""),
      truth ? el("p", {}, "Hidden: ", el("b", {}, truth.effects ? list(truth.effects) : truth.text), right ? ". You were right." : ". ", right || !truth.text ? "" : el("small", {}, truth.text))
        : el("p", { class: "hint" }, "Nobody knows what is in these measurements; see what the search says."),
      el("button", { type: "button", onclick: () => openSimulated() }, "Deal me another"));
  }
}

/** A freshly simulated pad with something unknown in it. */
export async function openSimulated() {
  const made = await trying(() => post("/api/sessions", { open: "deal" }));
  if (made) location.assign(`/s/${encodeURIComponent(made.id)}`);
}
