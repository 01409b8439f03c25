// Elements of the page, made in one line (no markup is ever put together as text), and messages to the user.

/** el("button", { class: "add", onclick: f, "aria-pressed": "true" }, "Add") */
export function el(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value == null || value === false) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name.startsWith("--")) made.style.setProperty(name, value);
    else if (["value", "checked", "selected"].includes(name)) made[name] = value;
    else made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.flat().filter((child) => child != null && child !== false));
  return made;
}

export const at = (selector, under = document) => under.querySelector(selector);

const KEPT = ["open", "style"]; // of an element that stays: what the reader has opened; styles, which go their own way
const keyOf = (node) => node.dataset?.key;
const alike = (old, fresh) => old.nodeName === fresh.nodeName && keyOf(old) === keyOf(fresh) && old.dataset?.act === fresh.dataset?.act;

/**
 * Shows these rows in place of what a host has. Elements that are still meant (the same data-key, or the same place) stay
 * in the page: focus, scrolling, open lists and a click that has just begun are not lost. What they do on events stays
 * too, so that it may depend on their key alone.
 */
export function refill(host, rows) {
  const keyed = new Map([...host.children].filter(keyOf).map((child) => [keyOf(child), child]));
  rows.forEach((row, place) => {
    const fresh = row instanceof Node ? row : document.createTextNode(String(row));
    const here = host.childNodes[place], old = keyOf(fresh) ? keyed.get(keyOf(fresh)) : here;
    const stays = old && alike(old, fresh);
    if (stays) become(old, fresh);
    const shown = stays ? old : fresh;
    if (shown !== here) host.insertBefore(shown, here ?? null);
  });
  while (host.childNodes.length > rows.length) host.lastChild.remove();
}

function become(old, fresh) {
  if (old.nodeType === Node.TEXT_NODE) { if (old.data !== fresh.data) old.data = fresh.data; return; }
  for (const { name } of [...old.attributes]) if (!KEPT.includes(name) && !fresh.hasAttribute(name)) old.removeAttribute(name);
  for (const { name, value } of fresh.attributes) if (!KEPT.includes(name) && old.getAttribute(name) !== value) old.setAttribute(name, value);
  if (old.style.cssText !== fresh.style.cssText) old.style.cssText = fresh.style.cssText;
  refill(old, [...fresh.childNodes]);
  if ("value" in old && (old !== document.activeElement || old.nodeName === "SELECT") && old.value !== fresh.value) old.value = fresh.value;
}

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
