// Energy over time as stacked bars; a bar is a button that opens its time.
import { drawn, element, energy, known, number, percent, setText, DASH, JOULE_PER_WH } from "./format.js";

const TOP = 10;
const BOTTOM = 34;
const STRIP = 5; // below the axis: the share of the time that was not observed
const KNOWN = 0.995; // observed share from which on a part of the time is whole

export const kindOf = (series, index) => (series.rest ? "s-rest" : series.kind ? `s-${series.kind}` : `s${index}`);

// Names with their colours; a line ends between two of them.
export function showLegend(host, entries) {
  host.replaceChildren(...entries.flatMap(([kind, name]) => [element("span", { class: "entry" }, element("span", { class: `key ${kind}` }), name), " "]));
}

export function niceStep(span, count) {
  const raw = span / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  return [1, 2, 2.5, 5, 10].map((factor) => factor * power).find((step) => step >= raw * 0.999);
}

// What lies in one part of the time: sums above and below zero; null where nothing was recorded.
function sums(series, place) {
  const values = series.map((one) => one.values[place]).filter(known);
  if (!values.length) return null;
  return { up: values.filter((v) => v > 0).reduce((a, b) => a + b, 0), down: values.filter((v) => v < 0).reduce((a, b) => a + b, 0) };
}

export function sentence(part, series, place, currency) {
  const own = series.filter((one) => known(one.values[place]));
  if (!own.length) return `${part.name}: not recorded`;
  const total = own.reduce((sum, one) => sum + one.values[place], 0);
  const split = own.length > 1 ? `: ${own.map((one) => `${one.name} ${energy(one.values[place])}`).join(", ")}` : "";
  const cost = known(part.cost) ? `, ${number(part.cost, 2)} ${currency}` : "";
  const seen = part.observed < KNOWN ? `; observed ${percent(part.observed, 0)} of the time` : "";
  return `${part.name}: ${energy(total)}${cost}${split}${seen}`;
}

export function drawBars(host, note, { parts, series, now, currency }, open) {
  const width = Math.max(300, host.clientWidth);
  const height = width < 560 ? 230 : 300;
  const all = parts.map((_, place) => sums(series, place));
  const high = Math.max(0, ...all.map((one) => one?.up ?? 0));
  const deepest = Math.min(0, ...all.map((one) => one?.down ?? 0));
  const low = -deepest > 0.01 * high ? deepest : 0; // less is not to be seen
  const unit = Math.max(high, -low) >= 100 * JOULE_PER_WH ? ["kWh", 1000 * JOULE_PER_WH] : ["Wh", JOULE_PER_WH];
  const step = niceStep(Math.max((high - low) / unit[1], 1e-3), 5);
  const [floor, top] = [Math.floor(low / unit[1] / step) * step, Math.max(step, Math.ceil(high / unit[1] / step) * step)];
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) + (step.toPrecision(2).includes("25") || step.toPrecision(2).includes("2.5") ? 1 : 0);
  const label = (level) => number(level, Math.min(digits, 4));
  const left = Math.max(46, 7.5 * Math.max(label(top).length, label(floor).length) + 14);
  const right = width - 4;
  const y = (value) => TOP + (1 - (value / unit[1] - floor) / (top - floor)) * (height - BOTTOM - TOP);
  const slot = (right - left) / parts.length;
  const svg = drawn("svg", { viewBox: `0 0 ${width} ${height}`, height, role: "group", "aria-label": "Energy over time; arrow keys go from bar to bar, Enter opens one" });
  svg.append(drawn("text", { class: "soft", x: 0, y: height - 9 }, unit[0]));
  for (let level = floor; level <= top + step / 2; level += step) {
    const at = y(level * unit[1]);
    svg.append(drawn("line", { class: "rule", x1: left, x2: right, y1: at, y2: at }),
      drawn("text", { class: "soft", x: left - 7, y: at + 4, "text-anchor": "end" }, label(level)));
  }
  const every = Math.max(1, Math.ceil((8.2 * Math.max(...parts.map((part) => part.label.length)) + 6) / slot));
  const bars = parts.map((part, place) => {
    const text = sentence(part, series, place, currency);
    const bar = drawn("g", { class: part.zoom && all[place] ? "bar" : "bar flat", role: part.zoom ? "button" : "img", tabindex: "-1", "aria-label": text, "data-place": place });
    const x = left + place * slot;
    bar.append(drawn("rect", { class: "frame", x, y: TOP, width: slot, height: height - BOTTOM - TOP }));
    const inner = Math.max(0.8, slot - Math.min(6, slot * 0.22));
    const edge = x + (slot - inner) / 2;
    let [up, down] = [0, 0];
    series.forEach((one, index) => {
      const value = one.values[place];
      if (!known(value) || value === 0) return;
      const from = value > 0 ? up : down;
      if (value > 0) up += value; else down += value;
      const [a, b] = [y(from), y(from + value)];
      bar.append(drawn("rect", { class: kindOf(one, index), x: edge, y: Math.min(a, b), width: inner, height: Math.abs(a - b) }));
    });
    const over = Math.min(part.stop, now) > part.start;
    if (!all[place] && over) bar.append(drawn("text", { class: "soft", x: x + slot / 2, y: y(0) - 5, "text-anchor": "middle" }, slot > 9 || place % 3 === 0 ? DASH : ""));
    const missing = over ? 1 - part.observed * (part.stop - part.start) / (Math.min(part.stop, now) - part.start) : 0;
    if (missing > 1 - KNOWN) bar.append(drawn("rect", { class: "unseen", x: edge, y: height - BOTTOM + 2, width: inner * Math.min(1, missing), height: STRIP }));
    if (place % every === 0) bar.append(drawn("text", { class: "soft", x: x + slot / 2, y: height - 9, "text-anchor": "middle" }, part.label));
    const show = () => setText(note, text);
    bar.addEventListener("pointerenter", show);
    bar.addEventListener("focus", () => { show(); bars.forEach((other) => other.setAttribute("tabindex", other === bar ? "0" : "-1")); });
    const enter = () => { if (part.zoom && all[place]) open(part.zoom); };
    bar.addEventListener("click", enter);
    bar.addEventListener("keydown", (event) => {
      const to = { ArrowLeft: place - 1, ArrowRight: place + 1, Home: 0, End: parts.length - 1 }[event.key];
      if (event.key === "Enter" || event.key === " ") enter();
      else if (to === undefined) return;
      else bars[Math.min(parts.length - 1, Math.max(0, to))].focus();
      event.preventDefault();
    });
    return bar;
  });
  bars[Math.max(0, all.findLastIndex(Boolean))]?.setAttribute("tabindex", "0");
  svg.append(...bars);
  setText(note, `Choose a bar to read it.${parts.some((part) => part.zoom) ? " A click or Enter opens its time." : ""}`);
  host.replaceChildren(svg);
}
