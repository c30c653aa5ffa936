// The picture of the energy flow: nodes in four columns, bands as wide as they are large.
// Sizes are whole units from the monitor, so that what enters a node leaves it.
import { DASH, drawn, number, percent } from "./format.js";

const NODE_WIDTH = 13;
const GAP = 18;
const TOP = 24;
const WIDE = [0, 1 / 3, 2 / 3, 1];
const NARROW = [0, 0.28, 0.57, 1]; // the labels on the right are the longest
const LETTER = 6.6; // width of one of a label, on average
const ORDER = ["grid", "capacitor", "bus", "friction", "drives", "motion", "capacitor_in", "grid_back", "brake", "cabinet"];

function kindOf(node) {
  if (node === "capacitor_in") return "capacitor";
  if (node === "grid_back") return "grid";
  return node.replace(/\d+$/, "");
}

function columnOf(node, enters) {
  if (node === "bus") return 1;
  if (node.startsWith("axis")) return enters ? 2 : 0;
  return enters ? 3 : 0;
}

function rankOf(id) {
  return ORDER.includes(id) ? ORDER.indexOf(id) : 20 + Number(/\d+$/.exec(id)?.[0] ?? 0);
}

// Stops of a band: its nodes, and a place of its own in every column between them, so that no
// band runs behind a node. Columns stand at these shares of the width; the outer ones leave room
// for labels of so many letters.
function layout(picture, width, height, places, letters) {
  const nodes = new Map();
  for (const id of Object.keys(picture.labels)) {
    const into = picture.flows.filter((flow) => flow[1] === id);
    const out = picture.flows.filter((flow) => flow[0] === id);
    const sum = (flows) => flows.reduce((total, flow) => total + flow[2], 0);
    const node = { id, into: sum(into), out: sum(out), inner: into.length > 0 && out.length > 0, rank: rankOf(id) };
    node.size = Math.max(node.into, node.out);
    node.column = columnOf(id, into.length > 0);
    nodes.set(id, node);
  }
  const columns = [0, 1, 2, 3].map((number) => [...nodes.values()].filter((node) => node.column === number));
  const bands = picture.flows.map(([source, target, units]) => {
    const from = nodes.get(source);
    const to = nodes.get(target);
    const stops = [from];
    for (let column = from.column + 1; column < to.column; column += 1) {
      const place = { size: units, column, rank: 100 + to.rank + (from.id === "bus" ? 0 : 50) };
      columns[column].push(place);
      stops.push(place);
    }
    stops.push(to);
    return { source, target, units, stops };
  });
  const room = (number) => {
    const longest = Math.max(0, ...columns[number].filter((stop) => stop.id).map((stop) => letters(stop)));
    return longest ? longest * LETTER + 8 : 0;
  };
  const [left, right] = [room(0), room(3)];
  for (const stop of columns[2]) stop.level = room(2) / 2;
  const gaps = (column) => column.reduce((total, stop, index) => total + (index ? gapOf(stop) : 0), 0);
  const scale = Math.min(...columns.filter((column) => column.length).map((column) =>
    (height - TOP - 8 - gaps(column)) / column.reduce((total, stop) => total + stop.size, 0)));
  columns.forEach((column, number) => {
    let y = TOP;
    column.sort((a, b) => a.rank - b.rank).forEach((stop, index) => {
      if (index) y += gapOf(stop);
      stop.x = left + places[number] * (width - left - right - NODE_WIDTH);
      stop.y = stop.left = stop.right = y;
      stop.height = Math.max(1, stop.size * scale);
      y += stop.size * scale;
    });
  });
  // Bands leave and enter each node in the order of their other ends, so that few cross.
  const around = (place, end) => bands.map((band) => ({ band, stop: band.stops.at(place), next: band.stops.at(end) }))
    .sort((a, b) => a.next.y - b.next.y || a.stop.y - b.stop.y);
  for (const { band, stop } of around(0, 1)) {
    band.thick = band.units * scale;
    band.y0 = stop.right + band.thick / 2;
    stop.right += band.thick;
  }
  for (const { band, stop } of around(-1, -2)) {
    band.y1 = stop.left + band.thick / 2;
    stop.left += band.thick;
  }
  return { nodes, bands };
}

const gapOf = (stop) => (stop.id ? GAP : GAP / 2);

// Bands are level around the joints, as far as the labels above these reach.
function bandPath({ stops, y0, y1, thick }) {
  const points = stops.map((stop, index) => [
    stop.x, index === 0 ? y0 : index === stops.length - 1 ? y1 : stop.y + thick / 2, stop.level ?? 0]);
  let text = `M${points[0][0] + NODE_WIDTH},${points[0][1]}`;
  for (let index = 1; index < points.length; index += 1) {
    const [x, y, level] = points[index];
    const from = points[index - 1];
    const [begin, end] = [from[0] + NODE_WIDTH + from[2], x - level];
    const half = (begin + end) / 2;
    text += `H${begin}C${half},${from[1]} ${half},${y} ${end},${y}H${x}`;
    if (index < points.length - 1) text += `H${x + NODE_WIDTH}`;
  }
  return text;
}

function sizeText(units, unit, isEnergy, energy = "Wh") {
  const digits = Math.max(0, Math.round(-Math.log10(unit)));
  return `${number(units * unit, digits)} ${isEnergy ? energy : "W"}`;
}

const fromGrid = (picture) => Math.max(1, picture.flows.reduce((sum, flow) => sum + (flow[0] === "grid" ? flow[2] : 0), 0));

// Rows of the table that says the same as the picture.
export function flowRows({ flows, labels, unit }, isEnergy) {
  const total = fromGrid({ flows });
  return flows.map(([source, target, units]) => [
    labels[source], labels[target], { text: sizeText(units, unit, isEnergy), kind: "n", data: units },
    { text: percent(units / total, 1), kind: "n" },
  ]);
}

// Draw a picture; false if there is none.
export function drawFlow(host, picture, isEnergy) {
  if (!picture || !picture.flows.length) {
    host.replaceChildren(document.createTextNode(DASH));
    delete host.dataset.net;
    return false;
  }
  const width = Math.max(300, host.clientWidth);
  const narrow = width < 560;
  const height = narrow ? 470 : 420;
  const total = fromGrid(picture);
  const text = (units) => sizeText(units, picture.unit, isEnergy, picture.energy);
  const label = (id) => picture.labels[id];
  const words = (node) => [label(node.id), `${text(node.size)}${node.column === 1 ? "" : `, ${percent(node.size / total, 0)}`}`];
  const { nodes, bands } = layout(picture, width, height, narrow ? NARROW : WIDE, (node) => (narrow ? 0 : words(node).join(" ").length));
  const main = [...nodes.values()].filter((node) => node.column === 3).map((node) => `${label(node.id)} ${text(node.into)}`);
  const svg = drawn("svg", {
    viewBox: `0 0 ${width} ${height}`, role: "img", height,
    "aria-label": `From the grid ${text(picture.net)}: ${main.join(", ")}`,
  });
  for (const band of bands) {
    const kind = kindOf(band.target).startsWith("axis") || band.target === "bus" ? kindOf(band.source) : kindOf(band.target);
    svg.append(drawn("path", {
      class: `link ${kind}`, "stroke-width": Math.max(0.6, band.thick),
      d: bandPath(band),
    }, drawn("title", {}, `${label(band.source)} to ${label(band.target)}: ${text(band.units)}`)));
  }
  for (const node of nodes.values()) {
    svg.append(drawn("rect", {
      class: `node ${kindOf(node.id)}`, x: node.x, y: node.y, width: NODE_WIDTH, height: node.height, rx: 2,
      "data-node": node.id, "data-in": node.into, "data-out": node.out, "data-inner": node.inner,
    }));
    svg.append(...nodeLabel(node, ...words(node), narrow));
  }
  host.replaceChildren(svg);
  host.dataset.net = picture.net;
  host.dataset.unit = picture.unit;
  return true;
}

// Outside of the picture where it has room, else above the node, where its own bands do not run.
function nodeLabel(node, name, size, narrow) {
  const [start, end] = [node.column === 0, node.column === 3];
  if (narrow || !(start || end)) {
    const anchor = start ? "start" : end || narrow ? "end" : "middle";
    const x = node.x + { start: 0, middle: NODE_WIDTH / 2, end: NODE_WIDTH }[anchor];
    return [drawn("text", { x, y: node.y - 5, "text-anchor": anchor },
      ...(narrow ? [name] : [`${name} `, drawn("tspan", { class: "soft" }, size)]))];
  }
  const x = start ? node.x - 6 : node.x + NODE_WIDTH + 6;
  const anchor = start ? "end" : "start";
  const middle = node.y + node.height / 2;
  if (node.height >= 30) {
    return [
      drawn("text", { x, y: middle - 2, "text-anchor": anchor }, name),
      drawn("text", { x, y: middle + 13, "text-anchor": anchor, class: "soft" }, size),
    ];
  }
  return [drawn("text", { x, y: middle + 4, "text-anchor": anchor }, `${name} `, drawn("tspan", { class: "soft" }, size))];
}
