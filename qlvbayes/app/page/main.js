// Puts the page together: which view is shown, and what each pane may do.
import { at, el, refill } from "./element.js";
import { Store } from "./store.js";
import { Session } from "./session.js";
import { Redraw } from "./redraw.js";
import { Measured } from "./measured.js";
import { ResidualMap } from "./map.js";
import { Hypotheses } from "./hypotheses.js";
import { Signatures } from "./signatures.js";
import { Constants } from "./constants.js";
import { Errors } from "./errors.js";
import { Jobs } from "./jobs.js";
import { downloads } from "./downloads.js";
import { start } from "./start.js";
import { ask } from "./asking.js";
import { drawSketch, waitFor } from "./wait.js";
import { plain } from "./numbers.js";
import { say, trying } from "./say.js";

const id = decodeURIComponent((location.pathname.match(/^\/s\/([^/]+)$/) || [])[1] || "");
if (id) bench(new Session(id, new Store({ stage: "opening", jobs: [], signatures: [], pads: [], busy: null, moved: false })));
else start();

function bench(session) {
  const { store } = session;
  const redraw = new Redraw(session), jobs = new Jobs(session), signatures = new Signatures(session);
  const hand = () => store.now.hand;
  const announced = async (work, words) => { const made = await work; if (made) say(words(made.state)); };
  const measured = new Measured(store);
  new ResidualMap(store);
  new Hypotheses(store, {
    add: (effect) => announced(session.make({ add: effect, model: hand() }, `Adding ${plain(effect)} …`), () => `${plain(effect)} is in the model.`),
    remove: (effect) => announced(session.make({ remove: effect, model: hand() }, `Taking out ${plain(effect)} …`), () => `${plain(effect)} is out of the model.`),
    law: (kind, name) => session.make({ [kind]: name, model: hand() }, `Fitting with ${name} …`),
    draw: (effect) => signatures.toggle(effect),
    diagnose: () => jobs.start("diagnose"),
  });
  new Constants(store, {
    move: (model) => redraw.want(model),
    fit: () => announced(session.make({ fit: hand() }, "Fitting …"), () => "Fitted."),
    keep: () => session.make({ keep: hand() }, "Keeping …"),
    undo: () => session.goTo(store.now.entry.current),
    sample: () => jobs.start("sample"),
  });
  new Errors(store, { goTo: (state) => session.goTo(state) });
  header(session);
  globalThis.bench = { store, measured }; // to look at from the console
  store.on(["stage", "hand", "questions", "error", "worker", "sketch"], () => arrange(session));
  store.on(["sketch"], ({ sketch }) => drawSketch(sketch));
  store.on(["notices", "found", "entry"], showNotices);
  store.on(["busy", "worker"], ({ busy, worker }) => {
    document.body.setAttribute("aria-busy", String(Boolean(busy)));
    at("#busy").textContent = worker === "restarting" ? "The worker stopped and is starting anew; nothing is lost …" : busy || "";
  });
  arrange(session);
  session.begin().catch((refusal) => {
    if (!refusal.error) throw refusal;
    store.set({ stage: "failed", error: refusal.error });
  });
}

/** What matters stands as warnings; how files were read is folded away. */
function showNotices({ notices = [], found = [], entry }) {
  const warnings = [...new Set([...notices, ...(entry?.notices || [])])];
  refill(at("#notices"), [...warnings.map((text) => el("p", { class: "warning small" }, text)),
    ...(found.length ? [el("details", { class: "small" }, el("summary", {}, `How the files were read (${found.length} findings)`), found.map((text) => el("p", {}, text)))] : [])]);
}

function header(session) {
  const { store } = session;
  const save = downloads(session);
  at("#tools").replaceChildren(el("span", { id: "busy", role: "status" }), save, el("a", { href: "/", class: "button" }, "Open …"));
  const ready = ({ hand }) => { save.hidden = !hand; };
  store.on(["hand"], ready);
  ready(store.now);
  store.on(["name", "pad"], ({ name, pad }) => { at("#name").textContent = name || ""; document.title = [pad && `Pad ${pad}`, name, "qlvbayes"].filter(Boolean).join(" · "); });
  store.on(["pads", "pad"], ({ pads, pad }) => refill(at("#views"), pads.map((one) => el("button", { type: "button", "data-key": one, "aria-pressed": String(one === pad), onclick: () => {
    history.replaceState(null, "", `#pad=${encodeURIComponent(one)}`);
    if (one !== store.now.pad) trying(() => session.choose(one));
  } }, `Pad ${one}`))));
}

/** Shows the one part of the page that belongs to what the session is doing. */
function arrange(session) {
  const { stage, hand } = session.store.now;
  const shown = stage === "asking" ? "#asking" : stage === "ready" && hand ? "#panes" : "#wait";
  const changed = at(shown).hidden;
  for (const part of ["#wait", "#asking", "#panes"]) at(part).hidden = part !== shown;
  if (shown === "#wait") waitFor(session.store.now);
  if (changed && shown === "#asking") ask(session);
}
