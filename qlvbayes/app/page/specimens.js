// Which test is of which pad, where a file holds several tests: all are of one, or each has its pad's name. What a
// pattern finds in the tests' names is the server's to say, so that the command line finds the same.
import { el } from "./element.js";
import { post } from "./api.js";

const PAUSE = 250; // ms after the last key before a pattern is looked for
const HOW = "specimens", ONE = "one", SEVERAL = "several";

/** The fields of the form, what is below it, and `given()`: the answers, or null where the pattern is of no use. */
export function specimens(session, { rows: [head, ...rows], ask: [how, ...tests], pad_from: suggested }) {
  const own = new Set(); // fields written in since the pattern was: its answer, which may come late, leaves them
  const inputs = tests.map(({ name, text, value }) => el("input", { id: `ask-${name}`, name, value: value ?? "", "aria-label": `Pad of ${text}`, autocomplete: "off", spellcheck: "false", oninput: (event) => { own.add(event.target); count(); } }));
  const wrong = el("p", { class: "wrong", id: "pattern-wrong", role: "alert", hidden: true });
  const counted = el("p", { role: "status" });
  const pattern = el("input", { id: "ask-pad_from", name: "pad_from", value: suggested, autocomplete: "off", spellcheck: "false", "aria-describedby": "pattern-hint pattern-wrong", oninput: () => wait(), onkeydown: (event) => {
    if (event.key !== "Enter") return;
    event.preventDefault(); // the names are shown before anything is read by them
    own.clear();
    find();
  } });
  const choice = (value, text) => el("label", {}, el("input", { type: "radio", name: HOW, value, checked: value === how.value, onchange: show }), text);
  const fields = el("fieldset", { class: "choices" }, el("legend", {}, "These tests are of"), choice(ONE, "one pad"), choice(SEVERAL, "several pads"));
  const naming = el("div", { class: "naming" },
    el("label", { for: pattern.id }, "Find the pad in each test's name by this pattern"), pattern,
    el("p", { class: "hint", id: "pattern-hint" }, "A regular expression: its first group is the pad's name, or without a group all that it matches. ", el("code", {}, "^[A-Z]+"), " finds AA in AA1. The names in the table can also be changed one by one."),
    wrong, counted);
  const cell = (text) => el("td", { class: "n" }, text);
  const padHead = el("th", { scope: "col" }, "Pad");
  const padCells = inputs.map((input) => el("td", {}, input));
  const table = el("div", { class: "wide", tabindex: "0" }, el("table", {}, el("caption", {}, "The tests of the file"),
    el("thead", {}, el("tr", {}, head.slice(0, 1).map((name) => el("th", { scope: "col" }, name)), padHead, head.slice(1).map((name) => el("th", { scope: "col", class: "n" }, name)))),
    el("tbody", {}, rows.map(([test, ...facts], row) => el("tr", {}, el("th", { scope: "row" }, test), padCells[row], facts.map(cell))))));
  const several = () => fields.querySelector(":checked").value === SEVERAL;
  let due = null, asked = 0;

  function show() {
    const on = several();
    naming.hidden = !on;
    for (const part of [padHead, ...padCells]) part.hidden = !on;
    for (const input of inputs) input.required = on;
    count();
  }

  function wait() {
    own.clear();
    clearTimeout(due);
    due = setTimeout(find, PAUSE);
  }

  /** Fills in what the pattern finds; the names stay where it finds none. */
  async function find() {
    clearTimeout(due);
    due = null;
    const mine = asked += 1, pad_from = pattern.value;
    let refused = null;
    if (pad_from) {
      try {
        const { pads } = await post(`${session.path}/specimens`, { pad_from });
        if (mine === asked) pads.forEach((pad, row) => { if (!own.has(inputs[row])) inputs[row].value = pad; });
      } catch (refusal) {
        if (!refusal.error) throw refusal;
        refused = refusal;
      }
    }
    if (mine !== asked) return true;
    wrong.textContent = refused ? refused.message : "";
    wrong.hidden = !refused;
    pattern.setAttribute("aria-invalid", String(Boolean(refused)));
    count();
    return !refused;
  }

  function count() {
    const pads = inputs.map((input) => input.value.trim()), none = pads.filter((pad) => !pad).length, of = [...new Set(pads)];
    const named = of.map((pad) => `${pad} (${many(pads.filter((one) => one === pad).length, "test")})`);
    counted.textContent = none ? `${none} of ${many(pads.length, "test")} without a pad so far.` : `${many(of.length, "pad")}: ${named.join(", ")}.`;
  }

  async function given() {
    if (!several()) return { [HOW]: ONE };
    if (due !== null && !(await find())) return null;
    return { [HOW]: SEVERAL, ...Object.fromEntries(inputs.map(({ name, value }) => [name, value.trim()])) };
  }

  show();
  return { title: "Which test is of which pad?", fields: [fields, naming, table], below: [], given, shown: () => {} };
}

const many = (count, what) => `${count} ${what}${count === 1 ? "" : "s"}`;
