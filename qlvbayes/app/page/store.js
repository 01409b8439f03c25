// What the page knows, and who hears of a change. Every pane reads from here and from nowhere else.

export class Store {
  constructor(first) {
    this.now = first;
    this.listeners = [];
  }

  /** Calls `tell(now)` after a change of any of these names. */
  on(names, tell) { this.listeners.push([names, tell]); }

  set(changes) {
    const changed = Object.keys(changes).filter((name) => this.now[name] !== changes[name]);
    Object.assign(this.now, changes);
    if (!changed.length) return;
    for (const [names, tell] of this.listeners) if (names.some((name) => changed.includes(name))) tell(this.now);
  }
}
