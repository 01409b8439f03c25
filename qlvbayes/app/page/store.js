// What the page knows, and who hears of a change. Every pane reads from here and from nowhere else.

export class Store {
  constructor(first) {
    this.now = first;
    this.listeners = [];
  }

  /** Calls `listener(now)` after a change of any of these names. */
  on(names, listener) { this.listeners.push([names, listener]); }

  set(changes) {
    const changed = Object.keys(changes).filter((name) => this.now[name] !== changes[name]);
    Object.assign(this.now, changes);
    if (!changed.length) return;
    for (const [names, listener] of this.listeners) if (names.some((name) => changed.includes(name))) listener(this.now);
  }
}
