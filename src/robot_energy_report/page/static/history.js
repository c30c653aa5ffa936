// The history page: asks for one period, shows it, and goes from a year to a minute and back.
import { byId, clock, duration, element, energy, energyParts, fillRows, known, number, percent, setText, signedPercent, DASH } from "./format.js";
import { ask, keep, setToken, tokenHash } from "./access.js";
import { drawBars, kindOf, showLegend } from "./bars.js";
import { baselineOf, fillBaseline, showFriction, showSavings } from "./savings.js";
import "./theme.js";

const REFRESH = 60000; // of a period that is not over [ms]
const MANY = 16; // robots from which on there are cells and a search
const PARTS = { friction: "friction", drives: "drive losses", motion: "lifting, accelerating", brake: "brake resistor", cabinet: "constant losses", capacitor: "capacitor" };
const BARS = {
  part: "Parts of the energy from the grid, less what was fed back. ",
  joint: "Electrical energy into the drives of the joints, without the cabinet. ",
  job: "Energy of jobs, in the time in which they ended; the rest is in no bar. ",
};
const OUT = { hour: "day", day: "month", week: "month", month: "year" };
const n = (text) => ({ text, kind: "n" });
const view = { answer: null, search: "", asked: 0 };

const params = () => new URLSearchParams(location.search);

function query(changes = {}) {
  const next = params();
  for (const [key, value] of Object.entries(changes)) {
    next.delete(key);
    for (const one of [value].flat()) if (one) next.append(key, one);
  }
  return next;
}

function go(changes) {
  history.pushState(null, "", `${location.pathname}?${query(changes)}${tokenHash()}`);
  load();
}

const goPeriod = (period) => go({ period: "", at: "", start: "", stop: "", ...period });
const cellOf = (name) => (name.includes("/") ? name.slice(0, name.indexOf("/")) : "");
// Not for times of which not as much was observed: fair is false then.
const change = (now, before) => (known(now) && known(before) && before > 0 ? signedPercent(now / before - 1) : DASH);
const money = (value) => (known(value) ? number(value, Math.abs(value) < 1 ? 4 : 2) : DASH);

function big(id, text, unit = "") {
  byId(id).replaceChildren(text, ...(unit ? [" ", element("small", {}, unit)] : []));
}

async function load() {
  const asked = ++view.asked;
  const wish = query({ fallback: Intl.DateTimeFormat().resolvedOptions().timeZone });
  try {
    const answer = await (await ask(`api/history?${wish}`)).json();
    if (asked !== view.asked) return;
    view.answer = answer;
    byId("trouble").hidden = true;
    byId("access").hidden = true;
    byId("content").hidden = false;
    keepFocus(show);
    await Promise.all([showShifts(asked, wish), loadFriction(asked, wish), loadSavings(asked, wish)]);
  } catch (error) {
    if (asked !== view.asked) return;
    if (error.message === "token") {
      return askToken();
    }
    setText(byId("status"), "no answer");
    byId("trouble").hidden = false;
    setText(byId("trouble"), error instanceof TypeError ? "no connection to the monitor" : error.message);
  }
}

// What had the focus may be gone, hidden or disabled then: the bars have it, not the top of the page.
function keepFocus(work) {
  const lost = ({ activeElement: one } = document) => one === document.body || one.disabled || one.hidden;
  const had = !lost();
  work();
  if (had && lost()) byId("bars").querySelector('[tabindex="0"]')?.focus({ preventScroll: true });
}

function askToken() {
  byId("access").hidden = false;
  byId("token").focus();
}

function show() {
  const { answer } = view;
  const { period, before } = answer;
  const shown = params().getAll("robot");
  setText(byId("status"), answer.running ? `as of ${clock(answer.now)}` : "over");
  setText(byId("period"), `${period.name}${shown.length ? `, ${shown.length === 1 ? shown[0] : `${shown.length} robots`}` : ""}`);
  document.title = `Robot energy: ${period.name}`;
  byId("later").disabled = Boolean(answer.running) || period.start > answer.now;
  byId("out").disabled = !OUT[period.period];
  for (const button of document.querySelectorAll("[data-by]")) button.setAttribute("aria-pressed", String(button.dataset.by === answer.group));
  for (const button of document.querySelectorAll("[data-period]")) button.setAttribute("aria-pressed", String(button.dataset.period === period.period && (period.period !== "day" || Boolean(answer.running))));
  byId("live").href = `.${tokenHash()}`;
  showBars();
  showHeadline(before);
  showRobots();
  showNight();
  showJobs();
  showEvents();
  showTariffs();
}

function named(series, group) {
  if (group === "part") return series.map((one) => ({ ...one, kind: one.name, name: PARTS[one.name] }));
  if (group === "phase") return series.map((one) => ({ ...one, kind: one.name }));
  return series;
}

function showBars() {
  const { answer } = view;
  const series = named(answer.series, answer.group);
  showLegend(byId("legend"), [...series.map((one, index) => [`part ${kindOf(one, index)}`, one.name]), ...(series.length ? [["unseen", "not observed"]] : [])]);
  const focused = byId("bars").contains(document.activeElement) ? document.activeElement.dataset.place : null;
  // Costs are those of all energy from the grid.
  const parts = BARS[answer.group] ? answer.parts.map((part) => ({ ...part, cost: null })) : answer.parts;
  drawBars(byId("bars"), byId("bar-note"), { ...answer, parts, series }, goPeriod);
  if (focused !== null) byId("bars").querySelector(`[data-place="${focused}"]`)?.focus();
  const remarks = answer.remarks.length ? `Some of it: ${answer.remarks.join(", ")}. ` : "";
  const last = answer.spans.at(-1);
  const zone = answer.timezone;
  const when = (seconds) => new Date(1000 * seconds).toLocaleString("sv", { timeZone: zone, dateStyle: "short", timeStyle: "short" });
  setText(byId("span-note"), `${BARS[answer.group] ?? ""}${remarks}${answer.span_count ? `${energy(answer.span_energy)} more lie in ${answer.span_count} span${answer.span_count > 1 ? "s" : ""} that no bar holds, as the recorder was off; the last, of ${last.robot}, from ${when(last.start)} to ${when(last.stop)}. ` : ""}Times of ${zone}.`);
}

function showHeadline(before) {
  const { total, same, earlier, fair, running, currency } = view.answer;
  big("energy", ...energyParts(total?.energy));
  const until = running ? " up to the same time" : "";
  setText(byId("energy-note"), !earlier ? `${before.name}${until}: not recorded`
    : fair ? `${change(same.energy, earlier.energy)} against ${before.name}${until} (${energy(earlier.energy)})`
      : `${before.name}${until}: ${energy(earlier.energy)} in ${duration(earlier.observed)} observed; now ${duration(same?.observed)}`);
  const against = (name) => (fair ? `${change(same[name], earlier[name])} against before` : "");
  big("cost", money(total?.cost), known(total?.cost) ? currency : "");
  const unpriced = total ? total.energy - total.priced : 0;
  setText(byId("cost-note"), !currency ? "no tariff" : unpriced > 0.5
    ? `${energy(unpriced)} have no price` : against("cost"));
  big("co2", number(total?.co2, total?.co2 < 10 ? 2 : 0), known(total?.co2) ? "kg" : "");
  setText(byId("co2-note"), known(total?.co2) ? against("co2") : "no factor in the tariff");
  big("standby", ...energyParts(total?.standby));
  setText(byId("standby-note"), total ? `${percent(total.standby / total.energy)} of the energy, ${duration(total.standby_time)}` : "");
  big("observed", ...duration(total?.observed).split(" "));
  setText(byId("observed-note"), total && known(total.measured)
    ? `${signedPercent(total.at_meter / total.measured - 1)} against the meter` : "no meter in this time");
}

function showRobots() {
  const { robots, known: all, currency } = view.answer;
  const chosen = params().getAll("robot");
  const many = all.length > MANY;
  byId("robot-search").hidden = !many;
  byId("all").hidden = !chosen.length;
  byId("cells-card").hidden = !many || !all.some(cellOf);
  byId("by-cell").hidden = byId("cells-card").hidden;
  if (!byId("cells-card").hidden) showCells();
  const found = robots.filter((one) => one.robot.toLowerCase().includes(view.search))
    .sort((a, b) => b.energy - a.energy);
  fillRows(byId("robots"), found.map((one) => [
    "", n(energy(one.energy)), n(change(one.same, one.fair ? one.before : null)), n(money(one.cost)), n(number(one.co2, 2)),
    n(energy(one.motion)), n(energy(one.hold)), n(energy(one.standby)), n(energy(one.friction)),
    n(energy(one.measured)), n(known(one.measured) && one.measured ? signedPercent(one.at_meter / one.measured - 1) : DASH), n(duration(one.observed)),
  ]));
  links("robots", found.map((one) => one.robot), (name) => go({ robot: name }));
  const moved = robots.filter((one) => one.fair && one.before > 0).sort((a, b) => Math.abs(b.same / b.before - 1) - Math.abs(a.same / a.before - 1));
  const most = moved.length > 1 ? `Largest changes: ${moved.slice(0, 3).map((one) => `${one.robot} ${change(one.same, one.before)}`).join(", ")}. ` : "";
  const absent = all.length - robots.length;
  setText(byId("robots-note"), `${most}${currency ? `Cost in ${currency}. ` : ""}${!chosen.length && absent > 0 ? `${absent} more robot${absent > 1 ? "s have" : " has"} nothing recorded in this time. ` : ""}${found.length < robots.length ? `${found.length} of ${robots.length} shown.` : ""}`);
}

function showCells() {
  const cells = new Map();
  for (const one of view.answer.robots) {
    const cell = cells.get(cellOf(one.robot)) ?? { robots: [], energy: 0, same: 0, before: 0, standby: 0, cost: null, fair: true };
    cell.robots.push(one.robot);
    for (const key of ["energy", "same", "before", "standby"]) cell[key] += one[key] ?? 0;
    cell.fair &&= one.fair;
    if (known(one.cost)) cell.cost = (cell.cost ?? 0) + one.cost;
    cells.set(cellOf(one.robot), cell);
  }
  const rows = [...cells].sort((a, b) => b[1].energy - a[1].energy);
  fillRows(byId("cells"), rows.map(([, one]) => ["", n(String(one.robots.length)), n(energy(one.energy)), n(change(one.same, one.fair ? one.before : null)), n(energy(one.standby)), n(money(one.cost))]));
  links("cells", rows.map(([name]) => name || "without"), (_, place) => go({ robot: rows[place][1].robots }));
}

// Names in the first column that open what they name.
function links(table, names, open) {
  names.forEach((name, place) => {
    const cell = byId(table).tBodies[0].rows[place].cells[0];
    const button = element("button", { type: "button", class: "plain" }, name);
    button.addEventListener("click", () => open(name, place));
    cell.replaceChildren(button);
  });
}

async function loadFriction(asked, wish) {
  const found = await (await ask(`api/history/friction?${wish}`)).json();
  if (asked !== view.asked) return;
  view.friction = found;
  showFriction(found, params().getAll("robot").length === 1 || view.answer.known.length === 1);
}

async function loadSavings(asked, wish) {
  const { period, timezone } = view.answer;
  fillBaseline(params(), new Date(1000 * period.start).toLocaleDateString("sv", { timeZone: timezone }));
  view.savings = null;
  byId("baseline-clear").hidden = !params().has("baseline_start");
  if (!params().has("baseline_start")) {
    byId("savings").hidden = true;
    return;
  }
  setText(byId("baseline-answer"), "comparing");
  try {
    const found = await (await ask(`api/history/savings?${wish}`)).json();
    if (asked !== view.asked) return;
    view.savings = found;
    setText(byId("baseline-answer"), "");
    keepFocus(showSaved);
  } catch (error) {
    if (asked !== view.asked) return;
    byId("savings").hidden = true;
    setText(byId("baseline-answer"), error.message);
  }
}

const showSaved = () => showSavings(view.savings, goPeriod, (name) => go({ robot: name }), links);

// Asked for after the rest, which does not wait for it.
async function showShifts(asked, wish) {
  const { rows, currency } = await (await ask(`api/history/shifts?${wish}`)).json();
  if (asked !== view.asked) return;
  byId("shifts-card").hidden = !rows.length;
  fillRows(byId("shifts"), rows.map((row) => [row.shift || "before any tariff", n(energy(row.energy)), n(energy(row.standby)), n(known(row.cost) ? `${money(row.cost)} ${currency}` : DASH)]));
}

function showJobs() {
  const { jobs } = view.answer;
  fillRows(byId("jobs"), jobs.map((job) => [job.name, job.robot, n(String(job.count)), n(energy(job.energy)),
    n(energy(job.mean)), n(energy(job.before)), n(change(job.mean, job.before)), n(duration(job.time))]));
  setText(byId("jobs-note"), jobs.length ? "Before: mean of the same job in the period before." : "No job ended in this time.");
}

function showEvents() {
  const { events } = view.answer;
  fillRows(byId("events"), events.map((one) => [one.at, one.robot, one.kind, one.text]));
  setText(byId("events-note"), events.length ? "" : "Nothing in this time.");
}

function showTariffs() {
  const { tariffs, control, currency, timezone } = view.answer;
  fillRows(byId("tariffs"), tariffs.map((one) => [one.begin, n(known(one.price_per_kwh) ? `${one.price_per_kwh} ${one.currency}` : DASH),
    one.time_of_use.map(timeText).join(", ") || DASH, n(known(one.co2_kg_per_kwh) ? `${one.co2_kg_per_kwh}${one.co2_source ? ` (${one.co2_source})` : ""}` : DASH), one.timezone, one.shifts.join(" ") || DASH]));
  setText(byId("tariffs-note"), control ? "" : `${tariffs.length ? "" : "No tariff yet. "}Prices are set here where the page has buttons (allow_control), or by: robot-energy history tariff --add FILE`);
  byId("tariff-card").hidden = !control;
  const last = tariffs.at(-1);
  const fields = { begin: new Date().toISOString().slice(0, 10), price: last?.price_per_kwh, currency: last?.currency ?? (currency || "EUR"),
    times: last?.time_of_use.map(timeText).join(", "), co2: last?.co2_kg_per_kwh, source: last?.co2_source, zone: last?.timezone ?? timezone, shifts: last?.shifts.join(" ") };
  for (const [name, value] of Object.entries(fields)) {
    const field = byId(`tariff-${name}`);
    if (!field.value) field.value = value ?? "";
  }
}

const timeText = (one) => `${one.days.length < 7 ? `${one.days.join(" ")} ` : ""}${one.begin}-${one.end} ${one.price_per_kwh}`;

function timeOf(text) {
  const found = /^((?:(?:mon|tue|wed|thu|fri|sat|sun) )*)(\d\d:\d\d)-(\d\d:\d\d) ([\d.]+)$/.exec(text.trim().replaceAll(/\s+/g, " "));
  if (!found) throw new Error(`'${text.trim()}' is not a time with its price, such as 22:00-06:00 0.17`);
  const days = found[1].trim().split(" ").filter(Boolean);
  return { ...(days.length ? { days } : {}), begin: found[2], end: found[3], price_per_kwh: Number(found[4]) };
}

function numberOf(name) {
  const text = byId(`tariff-${name}`).value.trim().replace(",", ".");
  if (text === "") return null;
  if (!known(Number(text))) throw new Error(`'${text}' is not a number`);
  return Number(text);
}

byId("tariff").addEventListener("submit", async (event) => {
  event.preventDefault();
  const field = (name) => byId(`tariff-${name}`).value.trim();
  const answer = byId("tariff-answer");
  try {
    const tariff = { begin: field("begin"), currency: field("currency"), timezone: field("zone"), price_per_kwh: numberOf("price"),
      time_of_use: field("times").split(",").filter((one) => one.trim()).map(timeOf), co2_kg_per_kwh: numberOf("co2"),
      co2_source: field("source"), shifts: field("shifts").split(/[\s,]+/).filter(Boolean) };
    const last = view.answer.tariffs.at(-1); // what has no field here stays
    if (last) Object.assign(tariff, { night: last.night, weekend: last.weekend });
    const said = await (await ask("api/history/tariff", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(tariff) })).json();
    setText(answer, said.message);
    load();
  } catch (error) {
    setText(answer, error.message === "token" ? "The token is needed: enter it above, then save." : error.message);
    if (error.message === "token") askToken();
  }
});

function showNight() {
  const { rests, currency } = view.answer;
  byId("night-card").hidden = !rests.length;
  fillRows(byId("night"), rests.map((row) => [row.name, n(energy(row.energy)), n(known(row.cost) ? `${money(row.cost)} ${currency}` : DASH)]));
}

for (const button of document.querySelectorAll("[data-by]")) button.addEventListener("click", () => go({ by: button.dataset.by }));
for (const button of document.querySelectorAll("[data-period]")) button.addEventListener("click", () => goPeriod({ period: button.dataset.period }));
byId("earlier").addEventListener("click", () => { const { name, ...period } = view.answer.before; goPeriod(period); });
byId("later").addEventListener("click", () => goPeriod(view.answer.next));
byId("out").addEventListener("click", () => goPeriod({ period: OUT[view.answer.period.period], at: view.answer.period.at }));
byId("all").addEventListener("click", () => go({ robot: "" }));
byId("span").addEventListener("click", () => {
  const form = byId("span-form");
  form.hidden = !form.hidden;
  byId("span").setAttribute("aria-expanded", String(!form.hidden));
  if (!form.hidden) byId("span-start").focus();
});
byId("span-form").addEventListener("submit", (event) => {
  event.preventDefault();
  const end = new Date(`${byId("span-stop").value}T00:00:00Z`);
  end.setUTCDate(end.getUTCDate() + 1);
  goPeriod({ period: "span", start: byId("span-start").value, stop: end.toISOString().slice(0, 10) });
});
byId("baseline").addEventListener("submit", (event) => { event.preventDefault(); go(baselineOf()); });
byId("baseline-clear").addEventListener("click", () => go({ baseline_start: "", baseline_stop: "", driver: "", measured: "" }));
byId("csv").addEventListener("click", async () => {
  try {
    keep(await (await ask(`history.csv?${query({ fallback: view.answer.timezone })}`)).blob(), "robot_energy_history.csv");
  } catch (error) {
    setText(byId("span-note"), error.message);
  }
});
byId("robot-search").addEventListener("input", () => { view.search = byId("robot-search").value.trim().toLowerCase(); showRobots(); });
byId("access").addEventListener("submit", (event) => { event.preventDefault(); setToken(byId("token").value); load(); });
addEventListener("popstate", load);
let width = innerWidth;
addEventListener("resize", () => { if (innerWidth !== width && view.answer) {
  width = innerWidth;
  showBars();
  if (view.savings) showSaved();
  if (view.friction) showFriction(view.friction, params().getAll("robot").length === 1 || view.answer.known.length === 1);
} });
setInterval(() => { if (!document.hidden && view.answer?.running) load(); }, REFRESH);
load();
