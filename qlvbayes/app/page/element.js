// Elements of the page, made in one line; no markup is ever put together as text.

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

/** Replaces what a list shows without losing where the keyboard is: rows are known by data-key. */
export function refill(host, rows) {
  const held = host.contains(document.activeElement) ? document.activeElement : null;
  const place = held && [held.closest("[data-key]")?.dataset.key, held.dataset.act];
  host.replaceChildren(...rows);
  if (!place) return;
  const row = [...host.querySelectorAll("[data-key]")].find((one) => one.dataset.key === place[0]);
  const again = row && (row.dataset.act === place[1] && place[1] ? row : row.querySelector(`[data-act="${place[1]}"]`));
  (again || row?.querySelector("button, input") || null)?.focus({ preventScroll: true });
}
