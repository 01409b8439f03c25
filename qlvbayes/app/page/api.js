// Calls to the server: JSON there and back, and errors as the one plain line that a command would print.

const TAB = Array.from(crypto.getRandomValues(new Uint32Array(2)), (part) => part.toString(36)).join("");

const NO_WORKER = 503, AGAIN = 5, PAUSE = 1500; // the worker died: asked again so many times, after so many ms

export class Refusal extends Error {
  /** error: { message, file, line, remedy, text }, as in every error of the server. */
  constructor(status, error) {
    super(error.text || error.message);
    Object.assign(this, { status, error });
  }

  get overtaken() { return this.status === 409 && this.error.message === "overtaken"; }
}

async function answered(response) {
  if (response.ok) return response.status === 204 ? null : response.json();
  let error = null;
  try { error = (await response.json()).error; } catch { /* not the server's own shape */ }
  throw new Refusal(response.status, error || { message: `The server answered ${response.status} ${response.statusText}.` });
}

async function ask(path, options, left = AGAIN) {
  let response;
  try {
    response = await fetch(path, { ...options, headers: { "X-Qlvbayes": "1", "X-Tab": TAB, ...options.headers } });
  } catch {
    throw new Refusal(0, { message: "The server does not answer. Nothing is lost: start qlvbayes app again and reload this page." });
  }
  if (response.status !== NO_WORKER || !left) return answered(response);
  await new Promise((done) => setTimeout(done, PAUSE));
  return ask(path, options, left - 1);
}

export const get = (path) => ask(path, {});
export const remove = (path) => ask(path, { method: "DELETE" });
export const post = (path, body = {}) =>
  ask(path, { method: "POST", body: JSON.stringify(body), headers: { "Content-Type": "application/json" } });

/** Sends files; the browser names the parts' boundary itself. */
export function upload(path, files) {
  const form = new FormData();
  for (const file of files) form.append("file", file, file.name);
  return ask(path, { method: "POST", body: form });
}
