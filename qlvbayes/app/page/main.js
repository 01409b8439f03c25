// Puts the page together: which view is shown, and what each pane may do.
import { at, el, refill, say, trying } from "./element.js";
import { Redraw, Session, Store } from "./session.js";
import { Measured } from "./measured.js";
import { ResidualMap } from "./map.js";
import { Hypotheses, Signatures } from "./hypotheses.js";
import { Constants } from "./constants.js";
import { Errors } from "./errors.js";
import { Jobs } from "./jobs.js";
import { ask, drawSketch, start, waitFor } from "./opening.js";
import { plain } from "./numbers.js";

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

/** What can be taken away: the report, the measurements, and how to repeat it all. */
function downloads(session) {
  const body = el("div", { class: "menu-body" });
  const menu = el("details", { class: "menu" }, el("summary", {}, "Save and export"), body);
  const fill = () => {
    const { pad } = session.store.now;
    body.replaceChildren(
      el("h3", {}, "All of it"), el("ul", { class: "named" },
        link(`${session.path}/report.html`, "Report", "with all figures, in one file; drawing it takes a moment", false),
        link(`${session.path}/tidy.csv`, "Measurements", "the tidy CSV that was read", true)),
      el("h3", {}, `Pad ${pad}, model in the list of errors`), el("ul", { class: "named" },
        link(`${session.padPath()}/repeat.sh`, "Command lines", "sample, check and diagnose it in a terminal", true)));
  };
  menu.addEventListener("toggle", fill);
  document.addEventListener("click", (event) => { if (!menu.contains(event.target)) menu.open = false; });
  menu.addEventListener("keydown", (event) => { if (event.key === "Escape") { menu.open = false; menu.firstChild.focus(); } });
  return menu;
}

function link(href, text, about, saved) {
  return el("li", {}, el("a", { href, download: saved, target: saved ? null : "_blank" }, text), el("span", {}, ` ${about}`));
}
