// The first page: drop measurements, open what is bundled, go on with a session.
import { at, el } from "./element.js";
import { get, post, remove, upload } from "./api.js";
import { calm, say, trying } from "./say.js";

const MIB = 1024 * 1024;

export async function start() {
  const host = at("#start");
  host.hidden = false;
  const known = await trying(() => get("/api/start"));
  if (!known) { host.replaceChildren(el("p", { class: "undone" }, "Nothing can be opened until the server answers. "), el("button", { type: "button", onclick: () => { calm(); start(); } }, "Try again")); return; }
  host.replaceChildren(
    el("p", { class: "under" }, "Lay the model over the measurements, see where it fails, add what is missing, and watch the error fall."),
    dropZone(known.upload_limit_bytes),
    el("div", { class: "boxes" }, bundled(known.bundled), earlier(known.sessions)),
    el("p", { class: "hint" }, `Version ${known.version}. All is computed on the machine that serves this page; nothing leaves it.`));
}

/** Where files are dropped or chosen; limit in bytes, where it is known. */
export function dropZone(limit) {
  const wrong = el("p", { class: "wrong", role: "alert", hidden: true });
  const input = el("input", { type: "file", id: "files", multiple: true, onchange: () => take(input.files, limit, wrong) });
  const zone = el("div", { class: "drop" },
    el("p", { class: "line" }, "Drop measurements here"),
    el("p", {}, "A CSV file, or the files of a testing machine."),
    el("label", { for: "files" }, "Or choose files "), input,
    el("p", { class: "hint" }, `Columns time_s, displacement_mm and force_N are read as they are; you are asked about others.${limit ? ` Up to ${Math.round(limit / MIB)} MiB.` : ""}`), wrong);
  // elsewhere on the page a dropped file must not replace the page
  for (const name of ["dragover", "drop"]) addEventListener(name, (event) => event.preventDefault());
  zone.addEventListener("dragenter", () => zone.classList.add("over"));
  zone.addEventListener("dragleave", (event) => { if (!zone.contains(event.relatedTarget)) zone.classList.remove("over"); });
  zone.addEventListener("drop", (event) => { event.preventDefault(); zone.classList.remove("over"); take(event.dataTransfer.files, limit, wrong); });
  return zone;
}

async function take(files, limit, wrong) {
  if (!files.length) return;
  const size = [...files].reduce((sum, file) => sum + file.size, 0);
  const refuse = (text) => { wrong.textContent = text; wrong.hidden = false; };
  if (limit && size > limit) { refuse(`These files are ${(size / MIB).toFixed(0)} MiB together; ${Math.round(limit / MIB)} MiB can be taken. Reduce them, or open them from the command line: qlvbayes app FILE.csv`); return; }
  wrong.hidden = true;
  say("Sending the files …");
  try {
    open(await upload("/api/upload", files));
  } catch (refusal) {
    if (!refusal.error) throw refusal;
    refuse(refusal.message);
  }
}

function open({ id }) { location.assign(`/s/${encodeURIComponent(id)}`); }

function bundled(all) {
  const go = async (name) => { const made = await trying(() => post("/api/sessions", { open: name })); if (made) open(made); };
  return el("article", { class: "box" }, el("h2", {}, "Bundled pads"),
    el("ul", { class: "named" }, all.map(({ name, text }) => el("li", {}, el("button", { type: "button", onclick: () => go(name) }, `Open ${name}`), el("span", {}, ` ${text}`)))));
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
