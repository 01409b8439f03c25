// A file that does not say all: its first lines, and a field for each thing that is open.
import { at, el } from "./element.js";
import { post } from "./api.js";

export function ask(session) {
  const { questions } = session.store.now, host = at("#asking");
  const wrong = el("p", { class: "wrong", role: "alert", hidden: true });
  const read = el("button", { type: "submit", class: "main" }, "Read it so");
  const send = async (event) => {
    event.preventDefault();
    wrong.hidden = true;
    read.disabled = true;
    try {
      const answers = Object.fromEntries([...new FormData(event.target)].map(([name, value]) => [name, value.trim()]).filter(([, value]) => value));
      session.store.set({ busy: "Reading …" });
      await post(`${session.path}/answers`, { answers });
      host.hidden = true; // another question is then asked anew
      await session.refresh();
    } catch (refusal) {
      if (!refusal.error) throw refusal;
      wrong.textContent = refusal.message;
      wrong.hidden = false;
    } finally {
      read.disabled = false;
      session.store.set({ busy: null });
    }
  };
  const several = questions.kind === "specimens";
  const form = el("form", { onsubmit: send }, several ? specimens(questions) : el("div", { class: "fields" }, questions.ask.map(field)),
    wrong, el("div", { class: "controls" }, read, el("a", { href: "/" }, "Open something else")));
  host.replaceChildren(
    el("h2", {}, several ? "Which test is of which pad?" : `What is what in ${questions.file}?`),
    el("p", {}, questions.text), form,
    questions.lines ? el("figure", {}, el("figcaption", {}, "The first lines of the file"), el("pre", { tabindex: "0" }, questions.lines)) : "");
  form.querySelector("select, input:checked, input:not([type=radio])").focus();
}

function field({ name, text, choices, value }) {
  const id = `ask-${name}`;
  const input = choices
    ? el("select", { id, name, required: true }, el("option", { value: "" }, "choose …"), choices.map((choice) => el("option", { value: choice, selected: choice === value }, choice)))
    : el("input", { id, name, required: true, value: value ?? "", autocomplete: "off" });
  return el("div", {}, el("label", { for: id }, text[0].toUpperCase() + text.slice(1)), input);
}

/** The tests of the file; with several pads a name for each test, which the server suggests. */
function specimens({ rows: [head, ...rows], ask: [how, ...tests] }) {
  const inputs = tests.map(({ name, text, value }) => el("input", { id: `ask-${name}`, name, value: value ?? "", "aria-label": `Pad of ${text}`, autocomplete: "off", spellcheck: "false" }));
  const cells = [el("th", { scope: "col" }, "Pad"), ...inputs.map((input) => el("td", {}, input))];
  const show = (value) => {
    for (const cell of cells) cell.hidden = value === "one";
    for (const input of inputs) input.required = value !== "one";
  };
  const choice = (value, text) => el("label", {}, el("input", { type: "radio", name: how.name, value, checked: value === how.value, onchange: () => show(value) }), text);
  show(how.value);
  return [
    el("fieldset", { class: "choices" }, el("legend", {}, "These tests are of"), choice("one", "one pad"), choice("several", "several pads, named in the table")),
    el("div", { class: "wide", tabindex: "0" }, el("table", {}, el("caption", {}, "The tests of the file"),
      el("thead", {}, el("tr", {}, el("th", { scope: "col" }, head[0]), cells[0], head.slice(1).map((name) => el("th", { scope: "col", class: "n" }, name)))),
      el("tbody", {}, rows.map(([test, ...facts], row) => el("tr", {}, el("th", { scope: "row" }, test), cells[row + 1], facts.map((text) => el("td", { class: "n" }, text)))))))];
}
