// What an effect would look like over the residual, and how much of it that takes.
import { post } from "./api.js";
import { percent, withUnit } from "./numbers.js";
import { say, trying } from "./say.js";

// Okabe and Ito's that no other line has, with dashes for readers of a grey copy.
const LOOKS = [{ colour: "#009e73", dash: [8, 3] }, { colour: "#cc79a7", dash: [2, 3] }, { colour: "#e69f00", dash: [8, 3, 2, 3] }];
const REST = 200; // ms after the last move of a slider

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
