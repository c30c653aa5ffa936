// Power over time: mean lines, the range from lowest to highest, and a cursor to read values.
import { clock, drawn, known, number, percent, byId, setText, watts } from "./format.js";

const MIN_LEFT = 52;
const DIGIT = 7; // width of one in the labels of the axis
const BOTTOM = 24;
const GRID = 0; // channels: predicted grid power, measured, predicted at the meter
const MEASURED = 1;
const AT_METER = 2;
const LOWER = 3; // ends of the 90 % band of the predicted grid power
const UPPER = 4;
let cursor = null;

// Add the newest buckets of a message to a ring; false if buckets in between are missing.
export function append(ring, fresh, most = 600) {
  if (!fresh.number.length) return true;
  if (!ring.number.length || fresh.width !== ring.width) return false;
  const last = ring.number[ring.number.length - 1];
  if (fresh.number[fresh.number.length - 1] < last) return false;
  fresh.number.forEach((number, index) => {
    const place = number === last ? ring.number.length - 1 : number > last ? ring.number.length : -1;
    if (place < 0) return;
    ring.number[place] = number;
    for (const key of ["mean", "low", "high"]) fresh[key].forEach((values, channel) => { ring[key][channel][place] = values[index]; });
  });
  const first = ring.number[ring.number.length - 1] - most;
  let drop = 0;
  while (ring.number[drop] <= first) drop += 1;
  if (drop) {
    ring.number.splice(0, drop);
    for (const key of ["mean", "low", "high"]) ring[key].forEach((values) => values.splice(0, drop));
  }
  return true;
}

function niceStep(span, count) {
  const raw = span / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  return [1, 2, 2.5, 5, 10].map((factor) => factor * power).find((step) => step >= raw);
}

// The ring with prediction and band as the meter shows them: readings are set against nothing else.
function atMeter(ring) {
  const shown = { ...ring };
  for (const key of ["mean", "low", "high"]) {
    shown[key] = ring[key].map((values, channel) => values.map((power, index) => {
      const [grid, meter] = [ring[key][GRID][index], ring[key][AT_METER][index]];
      if (channel === AT_METER) return known(meter) ? meter : grid;
      return channel >= LOWER && [power, grid, meter].every(known) ? power + meter - grid : power;
    }));
  }
  return shown;
}

export function drawLines(host, given, meter, span, stale) {
  const width = Math.max(300, host.clientWidth);
  const height = width < 560 ? 220 : 260;
  const metered = Boolean(given.mean[MEASURED]?.some(known));
  const ring = metered && meter !== "DC_BUS" ? atMeter(given) : given;
  const main = metered || meter === "DC_BUS" ? AT_METER : GRID;
  const banded = meter !== "DC_BUS" && Boolean(ring.mean[UPPER]?.some(known));
  const lows = [...ring.low[main] ?? [], ...ring.mean[MEASURED] ?? [], ...banded ? ring.mean[LOWER] : []].filter(known);
  const highs = [...ring.high[main] ?? [], ...ring.mean[MEASURED] ?? [], ...banded ? ring.mean[UPPER] : []].filter(known);
  if (!highs.length) {
    host.replaceChildren(document.createTextNode("no power yet"));
    setText(byId("lines-note"), "");
    return;
  }
  const bottom = Math.min(0, ...lows);
  const step = niceStep(Math.max(1, Math.max(...highs) - bottom) * 1.04, height < 240 ? 4 : 5);
  const floor = Math.floor(bottom / step) * step;
  const top = Math.ceil(Math.max(...highs, floor + step) / step) * step;
  const first = ring.number[0];
  const last = ring.number[ring.number.length - 1];
  const right = width - 8;
  const label = (level) => `${number(level, step < 1 ? 1 : 0)}${level + step > top + step / 2 ? " W" : ""}`;
  const left = Math.max(MIN_LEFT, DIGIT * label(top).length + 12);
  const x = (number) => left + ((number - first + 0.5) / Math.max(1, last - first + 1)) * (right - left);
  const y = (power) => 8 + (1 - (power - floor) / (top - floor)) * (height - BOTTOM - 8);
  const svg = drawn("svg", { viewBox: `0 0 ${width} ${height}`, height, role: "img", tabindex: "0",
    "aria-label": `Power over time, ${watts(Math.min(...lows))} to ${watts(Math.max(...highs))}; arrow keys read values` });
  for (let level = floor; level <= top + step / 2; level += step) {
    svg.append(drawn("line", { class: "rule", x1: left, x2: right, y1: y(level), y2: y(level) }),
      drawn("text", { class: "soft", x: left - 7, y: y(level) + 4, "text-anchor": "end" }, label(level)));
  }
  const ticks = width < 560 ? 3 : 6;
  for (let tick = 0; tick < ticks; tick += 1) {
    const at = first + ((last - first + 1) * (tick + 0.5)) / ticks;
    svg.append(drawn("text", { class: "soft", x: x(at - 0.5), y: height - 7, "text-anchor": "middle" }, clock(at * ring.width)));
  }
  if (banded) svg.append(drawn("path", { class: "band", d: area(ring, LOWER, x, y, "mean", UPPER) }));
  svg.append(drawn("path", { class: "area", d: area(ring, main, x, y) }));
  if (ring.mean[MEASURED]?.some(known)) svg.append(drawn("path", { class: "line measured", d: path(ring, MEASURED, x, y) }));
  svg.append(drawn("path", { class: "line predicted", d: path(ring, main, x, y) }));
  const focused = host.contains(document.activeElement);
  host.replaceChildren(svg);
  if (focused) svg.focus({ preventScroll: true });
  const covered = span?.coverage;
  setText(byId("lines-note"), `${percent(covered, covered < 1 ? 1 : 0)} of this span was observed.${stale ? " No new figures arrive." : ""}`);
  attachCursor(svg, ring, main, x, { first, last, left, right, bottom: height - BOTTOM });
}

function pieces(ring) {
  const found = [];
  ring.number.forEach((number, index) => {
    if (!index || number !== ring.number[index - 1] + 1) found.push([]);
    found[found.length - 1].push(index);
  });
  return found;
}

function path(ring, channel, x, y) {
  let text = "";
  for (const piece of pieces(ring)) {
    let pen = "M";
    for (const index of piece) {
      const value = ring.mean[channel][index];
      if (!known(value)) { pen = "M"; continue; }
      text += `${pen}${x(ring.number[index]).toFixed(1)},${y(value).toFixed(1)}`;
      pen = "L";
    }
  }
  return text;
}

function area(ring, channel, x, y, only = null, upper = channel) {
  let text = "";
  for (const piece of pieces(ring)) {
    const full = piece.filter((index) => known(ring[only ?? "low"][channel][index]));
    if (!full.length) continue;
    const point = (index, value) => `${x(ring.number[index]).toFixed(1)},${y(value).toFixed(1)}`;
    text += `M${full.map((index) => point(index, ring[only ?? "high"][upper][index])).join("L")}L${full.reverse().map((index) => point(index, ring[only ?? "low"][channel][index])).join("L")}Z`;
  }
  return text;
}

function attachCursor(svg, ring, main, x, edge) {
  const line = drawn("line", { class: "cursor", y1: 8, y2: edge.bottom, x1: -9, x2: -9 });
  const label = drawn("text", { y: 18, x: -999 });
  svg.append(line, label);
  const show = () => {
    const index = cursor === null ? -1 : ring.number.indexOf(cursor);
    if (index < 0) { label.setAttribute("x", -999); line.setAttribute("x1", -9); line.setAttribute("x2", -9); return; }
    const at = x(cursor);
    for (const key of ["x1", "x2"]) line.setAttribute(key, at);
    const end = at > (edge.left + edge.right) / 2;
    label.setAttribute("x", at + (end ? -6 : 6));
    label.setAttribute("text-anchor", end ? "end" : "start");
    setText(label, `${clock(cursor * ring.width)}: predicted ${watts(ring.mean[main][index])}, measured ${watts(ring.mean[MEASURED][index])}${known(ring.mean[UPPER]?.[index]) ? `, band ${watts(ring.mean[LOWER][index])} to ${watts(ring.mean[UPPER][index])}` : ""}`);
  };
  svg.addEventListener("pointermove", (event) => {
    const box = svg.getBoundingClientRect();
    const share = ((event.clientX - box.left) * (svg.viewBox.baseVal.width / box.width) - edge.left) / (edge.right - edge.left);
    cursor = Math.round(edge.first + share * (edge.last - edge.first + 1) - 0.5);
    show();
  });
  svg.addEventListener("pointerleave", () => { cursor = null; show(); });
  svg.addEventListener("keydown", (event) => {
    const move = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!move) return;
    event.preventDefault();
    cursor = Math.min(edge.last, Math.max(edge.first, (cursor ?? edge.last) + move));
    show();
  });
  show();
}
