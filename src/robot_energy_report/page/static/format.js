// Numbers, times and elements. What is not known is a dash.
export const DASH = "–";
export const JOULE_PER_WH = 3600;
const SVG = "http://www.w3.org/2000/svg";

export const known = (value) => typeof value === "number" && Number.isFinite(value);

export function number(value, digits = 0) {
  if (!known(value)) return DASH;
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text;
}

export function watts(value) {
  if (!known(value)) return DASH;
  return Math.abs(value) >= 9999.5 ? `${number(value / 1000, 2)} kW` : `${number(value, 0)} W`;
}

// Energy in the unit that fits its size: [text, unit].
export function energyParts(joule) {
  if (!known(joule)) return [DASH, ""];
  const wh = joule / JOULE_PER_WH;
  const size = Math.abs(wh);
  if (size >= 100) return [number(wh / 1000, size >= 1e5 ? 1 : 3), "kWh"];
  return [number(wh, size >= 10 ? 2 : 3), "Wh"];
}

export const energy = (joule) => energyParts(joule).join(" ").trim();
export const wh = (joule, digits = 3) => (known(joule) ? number(joule / JOULE_PER_WH, digits) : DASH);
export const percent = (share, digits = 1) => (known(share) ? `${number(100 * share, digits)} %` : DASH);

export function signedPercent(share) {
  return known(share) ? `${share > 0 ? "+" : ""}${number(100 * share, 1)} %` : DASH;
}

export function duration(seconds) {
  if (!known(seconds)) return DASH;
  if (seconds < 120) return `${number(seconds, 1)} s`;
  if (seconds < 7200) return `${number(seconds / 60, 1)} min`;
  return `${number(seconds / 3600, seconds < 360000 ? 2 : 0)} h`;
}

// Stamps before 2001 are those of a simulation: shown as seconds.
export function clock(seconds, withDate = false) {
  if (!known(seconds)) return DASH;
  if (seconds < 978307200) return `${number(seconds, 1)} s`;
  const date = new Date(1000 * seconds);
  const time = date.toLocaleTimeString([], { hour12: false });
  return withDate ? `${date.toLocaleDateString()} ${time}` : time;
}

export const byId = (id) => document.getElementById(id);

export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

export function element(name, attributes = {}, ...children) {
  const node = document.createElement(name);
  return filled(node, attributes, children);
}

export function drawn(name, attributes = {}, ...children) {
  return filled(document.createElementNS(SVG, name), attributes, children);
}

function filled(node, attributes, children) {
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== false && value != null) node.setAttribute(key, value === true ? "" : value);
  }
  node.append(...children);
  return node;
}

// Fill a table body in place, so that focus and selection stay. A cell is a text or
// {text, kind, data}; the first cell of a row is its header.
export function fillRows(table, rows) {
  const body = table.tBodies[0];
  while (body.rows.length > rows.length) body.deleteRow(-1);
  rows.forEach((cells, index) => {
    const row = body.rows[index] ?? body.insertRow();
    cells.forEach((cell, place) => {
      const { text, kind = "", data } = typeof cell === "object" ? cell : { text: cell };
      let node = row.cells[place];
      if (!node) {
        node = element(place ? "td" : "th", place ? {} : { scope: "row" });
        row.append(node);
      }
      setText(node, text);
      if (node.className !== kind) node.className = kind;
      if (data !== undefined) node.dataset.value = data ?? "";
    });
    while (row.cells.length > cells.length) row.deleteCell(-1);
  });
}
