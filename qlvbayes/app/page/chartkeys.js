// The keyboard in a chart: from sample to sample, zoom, all. What is there is read out.

const LEAP = 10; // samples with Shift

export function chartKeys(host, { view, spot, point, zoom, span }) {
  /** The next sample within what is shown; the first of it where none is meant yet. */
  const step = (from, by) => {
    const { samples, x } = view(), [min, max] = span();
    const shown = samples.flatMap((sample, k) => (sample && x[k] >= min && x[k] <= max ? [k] : []));
    const place = shown.indexOf(from);
    return shown[place < 0 ? 0 : Math.max(0, Math.min(shown.length - 1, place + by))];
  };
  const about = (factor) => {
    const [min, max] = span(), middle = spot() == null ? 0.5 * (min + max) : view().x[spot()];
    const [low, high] = view().whole(), reach = 0.5 * factor * (max - min);
    zoom(Math.max(low, middle - reach), Math.min(high, middle + reach));
  };
  const does = {
    ArrowLeft: (event) => point(step(spot(), event.shiftKey ? -LEAP : -1)),
    ArrowRight: (event) => point(step(spot(), event.shiftKey ? LEAP : 1)),
    "+": () => about(0.5), "=": () => about(0.5), "-": () => about(2),
    Escape: () => zoom(...view().whole()),
  };
  host.addEventListener("keydown", (event) => {
    if (event.target !== host || !does[event.key] || !view() || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    does[event.key](event);
  });
}
