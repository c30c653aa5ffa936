// The page: takes state and events, and shows the chosen robot.
import { byId, clock, energy, fillRows, setText, watts, JOULE_PER_WH } from "./format.js";
import { drawFlow, flowRows } from "./flow.js";
import { append, drawLines } from "./lines.js";
import { showAlarms, showFleet, showHeadline, showMeanPower, showPower, showTables, phaseText } from "./tables.js";
import "./theme.js";
import { keep, setToken, tokenHash } from "./access.js";
import { act, fetchSaved, fetchState, follow, restart } from "./stream.js";

const STALE = 2000; // without powers from the monitor the figures are stale [ms]
const DRAW = 240; // between two drawings of the lines [ms]
const view = { state: null, name: new URLSearchParams(location.search).get("robot") ?? "", flow: "energy_flow", span: "live", heard: 0, number: 0, drawn: 0, connected: false };

const place = () => Math.max(0, view.state.robots.findIndex((one) => one.name === view.name));
const robot = () => view.state?.robots[place()];
const stale = () => view.state?.live && (!view.connected || performance.now() - view.heard > STALE || robot()?.power.stale);

// What the browser itself has not heard of is not shown either.
function silenced(power) {
  return stale() ? { ...power, stale: true, phase: "UNKNOWN", predicted_grid_power: null, measured_power: null, predicted_power_at_meter: null } : power;
}

function withoutLive(shown) {
  const blank = (row) => Object.fromEntries(Object.keys(row).map((key) => [key, key === "name" ? row.name : key === "temperature_source" ? "UNKNOWN" : null]));
  const alarm = view.connected
    ? ["no power state arrives; live figures are not shown", "check that a monitor runs, is active, and receives joint states"]
    : ["this page has no connection to the monitor; live figures are not shown", "check that the dashboard runs and the network reaches it"];
  const alarms = [
    { level: "STALE", name: shown.name, message: alarm[0], remedy: alarm[1] },
    ...shown.alarms.filter((one) => one.name !== shown.name),
  ];
  const auxiliary = shown.auxiliary.map((load) => ({ ...load, state: null, power: null }));
  return { ...shown, alarms, auxiliary, outlet_power: null, means: null, flow: null, joints: shown.joints.map(blank), power: silenced(shown.power) };
}

function showStatus() {
  const status = byId("status");
  const shown = robot();
  let text = "live";
  let kind = "good";
  if (!view.state) [text, kind] = ["connecting", ""];
  else if (view.saved) [text, kind] = [`saved page, as of ${clock(shown?.power.time, true)}`, ""];
  else if (!view.connected) [text, kind] = ["no connection to the monitor", "bad"];
  else if (!view.state.live) [text, kind] = [`recording, ends at ${clock(shown?.power.time, true)}`, ""];
  else if (!shown) [text, kind] = ["no robot yet", "bad"];
  else if (stale()) [text, kind] = [shown.power.time ? `stale since ${clock(shown.power.time)}` : "no figures yet", "bad"];
  setText(status, text);
  status.className = `pill ${kind}`;
  document.body.classList.toggle("stale", kind === "bad");
  const phase = byId("phase");
  phase.hidden = !shown || stale() || !view.state.live;
  if (shown) setText(phase, phaseText(shown.power.phase));
}

function showLines() {
  const history = view.state.history?.[place()];
  if (!history || document.hidden) return;
  view.drawn = performance.now();
  drawLines(byId("lines"), history[view.span], robot().meter, robot().spans[view.span], stale());
}

function showFlow() {
  const picture = (stale() ? withoutLive(robot()) : robot())[view.flow];
  const isEnergy = view.flow === "energy_flow";
  const drawn = drawFlow(byId("flow"), picture, isEnergy);
  fillRows(byId("flows"), drawn ? flowRows(picture, isEnergy) : []);
  setText(byId("flow-note"), !drawn ? "no figures to show" : isEnergy
    ? `Since the registers began at zero: ${energy(picture.net * picture.unit * JOULE_PER_WH)} from the grid, as predicted.`
    : `Mean over one second: ${watts(picture.net * picture.unit)} from the grid, as predicted.`);
}

function showAll() {
  view.stale = Boolean(stale());
  showStatus();
  if (!view.state) return;
  byId("content").hidden = !robot();
  if (!robot()) return;
  const shown = stale() ? withoutLive(robot()) : robot();
  setText(byId("title"), view.state.count > 1 || !view.state.title ? shown.name : view.state.title);
  showHeadline(shown);
  if (view.state.live) showPower(shown.power); else showMeanPower(shown);
  showTables(shown);
  showAlarms(shown);
  showFleet(view.state, shown.name, choose, Boolean(view.saved));
  showFlow();
  showLines();
  byId("control").hidden = !view.state.control || Boolean(view.saved);
  setText(byId("foot"), `Model ${shown.model_id ?? "unknown"}. Predicted powers and energies are those of the model; measured ones those of the meter${shown.meter === "DC_BUS" ? " on the DC bus" : ""}.`);
}

// Another robot; one that is not here whole is asked for.
function choose(name) {
  view.name = name;
  const next = new URLSearchParams(location.search);
  next.set("robot", name);
  if (!view.saved) history.replaceState(null, "", `?${next}${location.hash}`);
  if (view.state.robots.some((one) => one.name === name)) showAll(); else restart();
}

const handle = {
  shown: () => view.name,
  begin(state) {
    Object.assign(view, { state, connected: true, heard: performance.now(), number: state.number });
    byId("access").hidden = true;
    byId("save").hidden = false;
    byId("past").hidden = !state.recorded;
    showAll();
  },
  state(state) {
    const known = view.state.history ?? [];
    view.state = { ...state, history: known, ...(state.count > state.robots.length ? { fleet: view.state.fleet } : {}) };
    const missing = view.name && state.robots.length && !state.robots.some((one) => one.name === view.name);
    if (missing && view.state.fleet?.some((one) => one.name === view.name)) return restart();
    view.heard = performance.now();
    const whole = known.length === state.robots.length && state.robots.every((one, index) =>
      Object.entries(one.buckets).every(([name, fresh]) => append(known[index][name], fresh)));
    if (!whole) refetch();
    showAll();
  },
  fleet(rows) {
    view.state.fleet = rows;
    if (robot()) showFleet(view.state, robot().name, choose, false);
  },
  power(event) {
    const missed = event.number > view.number + 1;
    view.number = event.number;
    view.heard = performance.now();
    let whole = !missed;
    event.robots.forEach((power, index) => {
      const one = view.state.robots[index];
      if (!one) return;
      one.power = power;
      const ring = view.state.history?.[index]?.live;
      if (ring && power.live && !append(ring, power.live)) whole = false;
    });
    if (!whole) refetch();
    if (!robot()) return;
    if (Boolean(stale()) !== view.stale) return showAll();
    if (view.state.live) showPower(silenced(robot().power));
    showStatus();
    if (performance.now() - view.drawn > DRAW && view.span === "live") showLines();
  },
  lost() {
    view.connected = false;
    if (view.state) showAll(); else showStatus();
  },
  refused() {
    byId("access").hidden = false;
    byId("token").focus();
    return new Promise((go) => { byId("access").onsubmit = (event) => {
      event.preventDefault();
      setToken(byId("token").value);
      setText(byId("access-answer"), "");
      go();
    }; });
  },
};

// Buckets are missing: fetch the history again, at most every five seconds.
let fetched = 0;
async function refetch() {
  if (performance.now() - fetched < 5000) return;
  fetched = performance.now();
  try {
    view.state.history = (await fetchState(view.name)).history;
  } catch { /* the stream notices what is wrong */ }
}

function switchOf(attribute, key) {
  const buttons = [...document.querySelectorAll(`[data-${attribute}]`)];
  for (const button of buttons) button.addEventListener("click", () => {
    view[key] = button.dataset[attribute];
    for (const other of buttons) other.setAttribute("aria-pressed", String(other === button));
    if (robot()) showAll();
  });
}

byId("save").addEventListener("click", async () => keep(await fetchSaved(view.name), "robot_energy.html"));
byId("past").addEventListener("click", () => { byId("past").href = `history${tokenHash()}`; });
async function control(action) {
  const name = byId("job-name").value.trim();
  const answer = byId("control-answer");
  try {
    const { message } = await act(robot().name, action, action === "reset_registers" ? name || "reset on the page" : name);
    setText(answer, message);
  } catch (error) {
    setText(answer, error.message === "token" ? "The token is needed." : "The monitor did not answer.");
    if (error.message !== "token") return;
    await handle.refused();
    byId("access").hidden = true;
    await control(action);
  }
}
for (const button of document.querySelectorAll("[data-action]")) {
  if (button.type !== "submit") button.addEventListener("click", () => control(button.dataset.action));
}
byId("control").addEventListener("submit", (event) => { event.preventDefault(); control("open_interval"); });
switchOf("flow", "flow");
switchOf("span", "span");
byId("robot-search").addEventListener("input", () => { if (robot()) showFleet(view.state, robot().name, choose, Boolean(view.saved)); });
let width = innerWidth;
addEventListener("resize", () => { if (innerWidth !== width && robot()) { width = innerWidth; showAll(); } });

const saved = byId("saved");
if (saved) {
  view.saved = true;
  Object.assign(view, { state: JSON.parse(saved.textContent), connected: true });
  view.state.live = false;
  showAll();
} else {
  setInterval(() => { if (Boolean(stale()) !== view.stale) showAll(); }, 250);
  follow(handle);
}
if (view.state && !view.state.live) document.querySelector('[data-span="all"]').click();
