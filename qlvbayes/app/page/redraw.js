// A slider's moves, one request at a time: the newest model is asked for, what came between is never asked.
import { post } from "./api.js";
import { byTest } from "./session.js";
import { trouble } from "./say.js";

const KEPT = 500; // measurements of how long a redraw takes, for whoever looks at performance.getEntriesByName("redraw")

export class Redraw {
  constructor(session) {
    Object.assign(this, { session, store: session.store, wanted: null, asking: false });
  }

  /** The model as the sliders have it now; it is drawn as soon as can be. */
  want(hand) {
    this.wanted ??= { since: performance.now() };
    this.wanted.hand = hand;
    if (!this.asking) this.ask();
    this.store.set({ hand, moved: true });
  }

  async ask() {
    const { hand, since } = this.wanted, epoch = this.session.epoch;
    this.wanted = null;
    this.asking = true;
    let curves = null;
    try {
      curves = byTest(await post(`${this.session.padPath()}/curves`, hand));
    } catch (refusal) {
      if (!refusal.error) throw refusal;
      if (!refusal.overtaken) trouble(refusal);
    } finally { this.asking = false; }
    if (this.wanted && this.wanted.hand === this.store.now.hand) this.ask(); // computed while this one is drawn
    else this.wanted = null;
    if (!curves || epoch !== this.session.epoch) return; // a fit or another pad came between: stale
    this.store.set({ shown: curves });
    afterFrame(() => this.measure(since));
  }

  /** From the move to the frame that shows it. */
  measure(since) {
    if (performance.getEntriesByName("redraw").length >= KEPT) performance.clearMeasures("redraw");
    performance.measure("redraw", { start: since, end: performance.now() });
  }
}

/** Once the frame that comes next was drawn. */
function afterFrame(callback) {
  requestAnimationFrame(() => {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = callback;
    port2.postMessage(null);
  });
}
