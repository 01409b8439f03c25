// The first page: drop measurements, open what is bundled, deal a pad, go on with a session.
import { at, el } from "./element.js";
import { get, post, remove, upload } from "./api.js";
import { openSimulated } from "./guess.js";
import { calm, say, trying } from "./say.js";

const MIB = 1024 * 1024;

export async function start() {
  const host = at("#start");
  host.hidden = false;
  host.replaceChildren(el("p", { class: "hint" }, "Looking what is there …"));
  const known = await trying(() => get("/api/start"));
  if (!known) { host.replaceChildren(el("p", { class: "undone" }, "Nothing can be opened until the server answers. "), el("button", { type: "button", onclick: () => { calm(); start(); } }, "Try again")); return; }
  host.replaceChildren(
    el("p", { class: "under" }, "Lay the model over the measurements, see where it fails, add what is missing, and watch the error fall."),
    dropZone(known.upload_limit_bytes),
    el("div", { class: "boxes" }, bundled(known.bundled), deal(), earlier(known.sessions)),
    el("p", { class: "hint" }, `Version ${known.version}. All is computed on the machine that serves this page; nothing leaves it.`));
}

/** Where files are dropped or chosen; limit in bytes, where it is known. */
export function dropZone(limit) {
  const wrong = el("p", { class: "wrong", role: "alert", hidden: true });
  const input = el("input", { type: "file", id: "files", multiple: true, onchange: () => take(input.files, limit, wrong) });
  const zone = el("div", { class: "drop" },
    el("p", { class: "line" }, "Drop measurements here"),
    el("p", {}, "One CSV file or several, or files of a testing machine."),
    el("label", { for: "files" }, "Or choose files "), input,
    el("p", { class: "hint" }, `Columns time_s, displacement_mm and force_N are read as they are; you are asked about others.${limit ? ` Up to ${Math.round(limit / MIB)} MiB.` : ""}`), wrong);
  dropOn(zone, (files) => take(files, limit, wrong));
  return zone;
}

/** Files dropped on an element; elsewhere on the page a dropped file must not replace the page. */
function dropOn(zone, taken) {
  for (const name of ["dragover", "drop"]) addEventListener(name, (event) => event.preventDefault());
  zone.addEventListener("dragenter", () => zone.classList.add("over"));
  zone.addEventListener("dragleave", (event) => { if (!zone.contains(event.relatedTarget)) zone.classList.remove("over"); });
  zone.addEventListener("drop", (event) => { event.preventDefault(); zone.classList.remove("over"); taken(event.dataTransfer.files); });
}

async function take(files, limit, wrong) {
  if (!files.length) return;
  const size = [...files].reduce((sum, file) => sum + file.size, 0);
  const refuse = (text) => { wrong.textContent = text; wrong.hidden = false; };
  if (limit && size > limit) { refuse(`These files are ${(size / MIB).toFixed(0)} MiB together; ${Math.round(limit / MIB)} MiB can be taken. Reduce them, or open them from the command line: qlvbayes app FILE.csv`); return; }
  wrong.hidden = true;
  say("Sending the files …");
  try {
    const made = await upload("/api/upload", files);
    open(made.id);
  } catch (refusal) {
    if (!refusal.error) throw refusal;
    refuse(refusal.message);
  }
}

function open(id) { location.assign(`/s/${encodeURIComponent(id)}`); }

function bundled(all) {
  const guess = el("input", { type: "checkbox", id: "guess-first" });
  const go = async (name) => { const made = await trying(() => post("/api/sessions", { open: name, ...(guess.checked ? { guess: true } : {}) })); if (made) open(made.id); };
  return el("article", { class: "box" }, el("h2", {}, "Bundled pads"),
    el("ul", { class: "named" }, all.map(({ name, text }) => el("li", {}, el("button", { type: "button", onclick: () => go(name) }, `Open ${name}`), el("span", {}, ` ${text}`)))),
    el("label", {}, guess, " Let me guess first: hide the ranking until I have written a guess"));
}

function deal() {
  return el("article", { class: "box" }, el("h2", {}, "Guess the effect"),
    el("p", {}, "A pad is simulated with something hidden in it that you do not know. Find out what."),
    el("button", { type: "button", onclick: () => openSimulated() }, "Deal me a pad"));
}

function earlier(sessions) {
  const row = ({ id, name, changed }) => {
    const item = el("li", {}, el("a", { href: `/s/${encodeURIComponent(id)}` }, name), el("span", {}, new Date(changed).toLocaleString([], { dateStyle: "medium", timeStyle: "short" })),
      el("button", { type: "button", class: "quiet", "aria-label": `Forget ${name}`, onclick: () => forget(id, name, item) }, "Forget"));
    return item;
  };
  return el("article", { class: "box" }, el("h2", {}, "Sessions"),
    sessions.length ? el("ul", { class: "named sessions" }, sessions.map(row)) : el("p", { class: "undone" }, "None yet. What you open stays here until you forget it."));
}

async function forget(id, name, item) {
  if (!confirm(`Forget ${name} and all that was computed for it?`)) return;
  await trying(async () => { await remove(`/api/s/${encodeURIComponent(id)}`); item.remove(); say(`${name} is forgotten.`); });
}
