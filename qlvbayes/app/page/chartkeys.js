// The keyboard in a chart: from sample to sample, zoom, all. What is there is read out.

const LEAP = 10; // samples with Shift

export function chartKeys(host, { view, spot, point, zoom, span }) {
  const step = (from, by) => {
    const { samples } = view();
    let next = from == null ? 0 : from + by;
    while (samples[next] === null) next += Math.sign(by);
    return Math.max(0, Math.min(samples.length - 1, next));
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
