// Messages to the user: a quiet line that screen readers read, and a loud one for what went wrong.
import { at, el } from "./element.js";

export function say(text) { at("#said").textContent = text; }

/** A trouble stays until it is put away or over. */
export function trouble(refusal) {
  const line = at("#trouble");
  const text = refusal.message || String(refusal);
  line.replaceChildren(el("span", {}, text), el("button", { type: "button", class: "quiet", "aria-label": "Put this message away", onclick: calm }, "✕"));
  line.hidden = false;
}

export function calm() { at("#trouble").hidden = true; }

/** Runs what may be refused; says so where it is. */
export async function trying(work) {
  try { return await work(); } catch (refusal) {
    if (!refusal.error) throw refusal;
    if (!refusal.overtaken) trouble(refusal);
    return null;
  }
}
