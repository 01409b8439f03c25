// Numbers as the page says them: four digits at most, a true minus, units behind.
import { report } from "./report.js";

export const short = (value) => report.short(value);

export function digits(value, many) { return value == null ? "–" : String(+value.toPrecision(many)).replace("-", "−"); }

export function withUnit(value, unit, many = 3) { return unit === "1" || !unit ? digits(value, many) : `${digits(value, many)} ${unit}`; }

export function percent(share) {
  if (share == null) return "–";
  if (share > 0.99 && share < 1) return "> 99 %";
  if (share > 0 && share < 0.01) return "< 1 %";
  return `${Math.round(100 * share)} %`;
}

/** "40 s", "3 min": how long something takes. */
export function span(seconds) {
  if (seconds == null) return "";
  if (seconds < 90) return `${Math.max(1, Math.round(seconds))} s`;
  return seconds < 5400 ? `${Math.round(seconds / 60)} min` : `${digits(seconds / 3600, 2)} h`;
}

export function times(ratio) { return ratio == null ? "–" : ratio < 9.95 ? ratio.toFixed(1) : ratio.toFixed(0); }

/** A name of the catalogue as words: viscous_drag is "viscous drag". */
export const plain = (name) => name.replaceAll("_", " ");
