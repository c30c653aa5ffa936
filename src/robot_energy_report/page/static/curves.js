// Curves over parts of a time, some with a band, and a cursor that reads them by pointer and keys.
import { drawn, known, number, setText } from "./format.js";
import { niceStep } from "./bars.js";

const TOP = 8;
const BOTTOM = 24;

// `places` have a label; `series` name, kind, values, and low and high where there is a band. null is
// not known: the line is broken there. A line lies at `level`, unless it is null. `read` gives the
// sentence of a place.
export function drawCurves(host, note, { title, places, series, digits, unit, level, read, hint }) {
  const width = Math.max(300, host.clientWidth);
  const height = width < 560 ? 210 : 250;
  const all = series.flatMap((one) => [...one.values, ...(one.low ?? []), ...(one.high ?? [])]).filter(known);
  if (known(level)) all.push(level);
  const [least, most] = [Math.min(...all), Math.max(...all)];
  const step = niceStep(Math.max((most - least) * 1.02, 10 ** -digits), height < 240 ? 4 : 5);
  const floor = Math.floor(least / step + 1e-9) * step;
  const top = Math.max(floor + step, Math.ceil(most / step - 1e-9) * step);
  const label = (value) => number(value, digits);
  const left = Math.max(46, 7.5 * Math.max(label(top).length, label(floor).length) + 14);
  const right = width - 8;
  const x = (place) => left + ((place + 0.5) / places.length) * (right - left);
  const y = (value) => TOP + (1 - (value - floor) / (top - floor)) * (height - BOTTOM - TOP);
  const svg = drawn("svg", { viewBox: `0 0 ${width} ${height}`, height, role: "img", tabindex: "0",
    "aria-label": `${title}; arrow keys read values` });
  for (let value = floor; value <= top + step / 2; value += step) {
    svg.append(drawn("line", { class: "rule", x1: left, x2: right, y1: y(value), y2: y(value) }),
      drawn("text", { class: "soft", x: left - 7, y: y(value) + 4, "text-anchor": "end" }, label(value)));
  }
  if (known(level)) svg.append(drawn("line", { class: "level", x1: left, x2: right, y1: y(level), y2: y(level) }));
  svg.append(drawn("text", { class: "soft", x: left - 7, y: height - 7, "text-anchor": "end" }, unit));
  const wide = 7.6 * Math.max(...places.map((one) => one.label.length));
  const every = Math.max(1, Math.ceil((wide + 8) * places.length / (right - left)));
  const within = (at) => Math.min(right - wide / 2, Math.max(left + wide / 2, at));
  places.forEach((one, place) => { if (place % every === 0) svg.append(drawn("text", { class: "soft", x: within(x(place)), y: height - 7, "text-anchor": "middle" }, one.label)); });
  const point = (place, value) => `${x(place).toFixed(1)},${y(value).toFixed(1)}`;
  for (const one of series) {
    for (const piece of one.low ? pieces(one.values) : []) {
      svg.append(drawn("path", { class: "area", d: `M${piece.map((place) => point(place, one.high[place])).join("L")}L${[...piece].reverse().map((place) => point(place, one.low[place])).join("L")}Z` }));
    }
    const found = pieces(one.values);
    svg.append(drawn("path", { class: `curve ${one.kind}`, d: found.map((piece) => `M${piece.map((place) => point(place, one.values[place])).join("L")}`).join("") }));
    for (const piece of found) {
      if (places.length > 62 && piece.length > 1) continue; // a day alone would not be seen otherwise
      for (const place of piece) svg.append(drawn("circle", { class: `dot ${one.kind}`, cx: x(place), cy: y(one.values[place]), r: 2.4 }));
    }
  }
  const line = drawn("line", { class: "cursor", y1: TOP, y2: height - BOTTOM, x1: -9, x2: -9 });
  svg.append(line);
  let cursor = null;
  const show = (place) => {
    cursor = place === null ? null : Math.min(places.length - 1, Math.max(0, place));
    for (const key of ["x1", "x2"]) line.setAttribute(key, cursor === null ? -9 : x(cursor));
    setText(note, cursor === null ? hint : read(cursor));
  };
  svg.addEventListener("pointermove", (event) => {
    const box = svg.getBoundingClientRect();
    const at = (event.clientX - box.left) * (width / box.width);
    show(Math.floor(((at - left) / (right - left)) * places.length));
  });
  svg.addEventListener("pointerleave", () => show(null));
  svg.addEventListener("keydown", (event) => {
    const last = places.length - 1;
    const to = { ArrowLeft: (cursor ?? last + 1) - 1, ArrowRight: (cursor ?? -1) + 1, Home: 0, End: last }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    show(to);
  });
  show(null);
  host.replaceChildren(svg);
}

// Runs of places that are known.
function pieces(values) {
  const found = [];
  values.forEach((value, place) => {
    if (!known(value)) return;
    if (!place || !known(values[place - 1])) found.push([]);
    found.at(-1).push(place);
  });
  return found;
}
