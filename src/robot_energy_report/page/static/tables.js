// Headline, tables, alarms and diagnostics.
import { byId, clock, duration, element, energy, energyParts, fillRows, known, number, percent, setText, signedPercent, watts, wh, DASH } from "./format.js";

const PHASES = { UNKNOWN: "unknown", HOLD: "hold", MOTION: "motion", GENERATING: "generating" };
const CORRECTED = ", corrected by learned figures";
const SOURCES = { MEASURED: "measured", FALLBACK: "fallback", ESTIMATED: "estimated", UNKNOWN: DASH };
const REGISTERS = [
  ["predicted_import_energy", "from the grid, predicted"],
  ["predicted_energy_learned", "from the grid, of it with learned figures"],
  ["predicted_return_energy", "back to the grid, predicted"],
  ["predicted_energy_band", "90 % band of the net energy, ±"],
  ["measured_energy", "at the meter, measured"],
  ["predicted_energy_at_meter", "at the meter, predicted"],
  ["brake_energy", "brake resistor"],
  ["loss_dc_energy", "constant losses, DC side"],
  ["loss_grid_energy", "constant losses, grid side"],
  ["capacitor_energy", "capacitor"],
];
const TIMES = [["observed_time", "observed"], ["gap_time", "gaps"], ["comparison_time", "compared with the meter"]];
const n = (text, data) => ({ text, kind: "n", data });

export const phaseText = (phase) => PHASES[phase] ?? "unknown";

function big(id, text, unit = "") {
  const node = byId(id);
  if (node.dataset.shown === `${text} ${unit}`) return;
  node.dataset.shown = `${text} ${unit}`;
  node.replaceChildren(text, ...(unit ? [" ", element("small", {}, unit)] : []));
}

export function showPower(power) {
  const pair = known(power.measured_power) && !power.stale;
  const half = (power.predicted_power_upper - power.predicted_power_lower) / 2;
  const sure = known(half) ? ` ± ${watts(half)}` : "";
  // A reading is set against the prediction over its own interval, as the meter shows it.
  const shown = pair ? power.predicted_power_at_meter : power.predicted_grid_power;
  big("power", known(shown) ? number(shown) : DASH, "W");
  setText(byId("power-note"), power.stale ? "stale: no power state arrives"
    : pair ? `predicted at the meter${sure}${power.corrected ? CORRECTED : ""}; measured ${watts(power.measured_power)}` : `predicted${sure}; no meter`);
  byId("power").dataset.time = power.time ?? "";
}

// A recording has no now: its mean power, of the energy and time of the registers as in the headline.
export function showMeanPower(robot) {
  const joule = robot.headline.energy;
  const seconds = robot.registers?.observed_time;
  setText(byId("power-title"), "Mean power");
  big("power", known(joule) && seconds > 0 ? number(joule / seconds) : DASH, "W");
  setText(byId("power-note"), `predicted, over ${duration(seconds)}`);
}

export function showHeadline(robot) {
  const { headline, registers } = robot;
  big("energy", ...energyParts(headline.energy));
  const half = registers?.predicted_energy_band;
  const sure = known(half) && headline.energy > 0 ? ` ± ${percent(half / headline.energy)}` : "";
  const start = registers ? `predicted${sure}, since ${clock(registers.energy_start, true)}` : "no register yet";
  const atMeter = registers?.predicted_energy_at_meter; // not known in the first seconds
  const error = known(atMeter) ? atMeter / registers.measured_energy - 1 : null;
  const corrected = registers?.predicted_energy_learned > 0 ? CORRECTED : "";
  setText(byId("energy-note"), known(error) ? `${start}; ${signedPercent(error)} against the meter${corrected}` : start);
  const job = headline.job;
  big("job", ...energyParts(job?.energy));
  setText(byId("job-note"), job ? `${job.name}; mean of ${job.count}: ${energy(job.mean)}` : "no closed job interval");
  big("cost", known(headline.cost) ? number(headline.cost, headline.cost < 1 ? 4 : 2) : DASH, known(headline.cost) ? headline.currency : "");
  setText(byId("cost-note"), known(headline.cost)
    ? `since ${clock(headline.cost_since, true)}; now ${number(headline.price, 3)} ${headline.currency}/kWh` : "no price in the page settings");
  const grams = known(headline.co2) && headline.co2 < 1;
  big("co2", known(headline.co2) ? number(grams ? 1000 * headline.co2 : headline.co2, grams ? 1 : 3) : DASH, known(headline.co2) ? (grams ? "g" : "kg") : "");
  setText(byId("co2-note"), known(headline.co2)
    ? `${headline.co2_factor} kg/kWh${headline.co2_source ? `, ${headline.co2_source}` : ""}` : "no factor in the page settings");
}

export function showTables(robot) {
  fillRows(byId("joints"), robot.joints.map((joint) => [
    joint.name,
    n(number(joint.motor_temperature_degc, 1)),
    { text: SOURCES[joint.temperature_source], kind: joint.temperature_source === "FALLBACK" ? "warm" : "" },
    n(number(joint.friction_power, 1)), n(number(joint.drive_loss, 1)), n(number(joint.rigid_power, 1)),
    n(number(joint.motor_torque, 2)), n(number(joint.motor_velocity, 1)),
    n(number(joint.coulomb, 3)), n(number(known(joint.viscous) ? 1000 * joint.viscous : null, 3)),
  ]));
  byId("auxiliary-card").hidden = !robot.auxiliary.length;
  fillRows(byId("auxiliary"), robot.auxiliary.map((load) => [
    load.name, load.state ?? DASH, n(number(load.power, 1)), n(energy(load.energy), load.energy),
    n(duration(load.known_time)), n(duration(load.missing_time)),
  ]));
  const { registers } = robot;
  const outlet = known(registers?.outlet_energy)
    ? ` From the outlet, cabinet and loads, while all are known (${duration(registers.outlet_time)}): ${energy(registers.outlet_energy)}.` : "";
  setText(byId("auxiliary-note"), `Outlet now: ${known(robot.outlet_power) ? watts(robot.outlet_power) : "not known"}.${outlet}`);
  fillRows(byId("registers"), registers ? [
    ...REGISTERS.map(([key, label]) => [label, n(energy(registers[key])), n(number(registers[key], 3), registers[key])]),
    ...TIMES.map(([key, label]) => [label, n(duration(registers[key])), n(number(registers[key], 3), registers[key])]),
    ["number of gaps", n(number(registers.gap_count)), n(number(registers.gap_count), registers.gap_count)],
  ] : []);
  byId("registers").dataset.time = registers?.time ?? "";
  const early = known(registers?.measured_energy) && !known(registers.predicted_energy_at_meter);
  setText(byId("registers-note"), registers
    ? `As of ${clock(registers.time, true)}; ${registers.persisted ? "on disk" : "in memory only"}.${early ? " The time compared is still too short for a meter that lags." : ""}` : "No register has arrived.");
  fillRows(byId("shaft"), (registers?.joints ?? []).map((joint) => [
    joint.name, n(wh(joint.rigid_energy), joint.rigid_energy), n(wh(joint.friction_energy), joint.friction_energy),
    n(wh(joint.drive_loss_energy), joint.drive_loss_energy),
  ]));
  const total = robot.phases.reduce((sum, phase) => sum + phase.seconds, 0);
  fillRows(byId("phases"), robot.phases.map((phase) => [
    phaseText(phase.name), n(duration(phase.seconds)), n(percent(phase.seconds / total)),
    n(energy(phase.energy)), n(watts(phase.mean)),
  ]));
  showIntervals(robot);
}

function showIntervals(robot) {
  const intervals = robot.intervals ?? [];
  fillRows(byId("intervals"), intervals.map((job) => [
    job.is_open ? `${job.name} (open)` : job.name, clock(job.start), n(duration(job.seconds)),
    n(energy(job.predicted_import_energy)), n(energy(job.measured_energy)), n(percent(job.coverage, 1)),
    n(watts(job.predicted_peak_power)),
  ]));
  setText(byId("intervals-note"), robot.intervals === null ? "The monitor offers no list of job intervals here."
    : intervals.length ? "" : "None yet: open one at the beginning of a job, close it at its end.");
}

export function showAlarms(robot) {
  byId("alarm-card").hidden = !robot.alarms.length;
  const key = JSON.stringify(robot.alarms.map(({ level, name, message }) => [level, name, message]));
  const list = byId("alarms");
  if (list.dataset.key !== key) {
    list.dataset.key = key;
    list.replaceChildren(...robot.alarms.map((alarm) => element("li", {},
      element("p", {}, element("span", { class: `level ${alarm.level}` }, alarm.level), `${alarm.name}: ${alarm.message}`),
      element("p", { class: "small" }, `What to do: ${alarm.remedy}`))));
  }
  showDiagnostics(robot.findings);
}

function showDiagnostics(findings) {
  const host = byId("diagnostics");
  const names = findings.map((finding) => finding.name).join("\n");
  if (host.dataset.names !== names || !host.childElementCount) {
    host.dataset.names = names;
    host.replaceChildren(...(findings.length ? findings.map(() => element("details", {},
      element("summary", {}, element("span", { class: "level" }), element("span")), element("dl")))
      : [element("p", { class: "small" }, "No diagnostic status here.")]));
  }
  findings.forEach((finding, index) => {
    const node = host.children[index];
    const [level, text] = node.querySelectorAll("span");
    level.className = `level ${finding.level}`;
    setText(level, finding.level);
    setText(text, `${finding.name}: ${finding.message}`);
    if (!node.open) return;
    node.querySelector("dl").replaceChildren(...Object.entries(finding.values).map(([key, value]) =>
      element("div", {}, element("dt", {}, key), element("dd", {}, value))));
  });
}

// A row of the overview, of a robot that is here whole.
const overview = ({ name, power, headline, alarms }) => ({ ...power, name, energy: headline.energy, alarms: alarms.length });
const powerOf = (row) => (known(row.measured_power) ? row.predicted_power_at_meter : row.predicted_grid_power);
const cellOf = (name) => (name.includes("/") ? name.slice(0, name.indexOf("/") + 1) : "");
const total = (rows, value) => (rows.some((row) => known(value(row))) ? rows.reduce((sum, row) => sum + (known(value(row)) ? value(row) : 0), 0) : null);

// All robots: those of `fleet` if there are many, else those that are here whole.
export function showFleet({ fleet, robots }, chosen, choose, saved) {
  const all = fleet ?? robots.map(overview);
  byId("fleet").hidden = all.length < 2;
  byId("robot-search").hidden = !fleet;
  const wanted = fleet ? byId("robot-search").value.trim().toLowerCase() : "";
  const rows = all.filter((row) => row.name.toLowerCase().includes(wanted));
  fillRows(byId("robots"), rows.map((row) => [row.name, row.stale ? "stale" : phaseText(row.phase),
    n(watts(powerOf(row))), n(watts(row.measured_power)), n(energy(row.energy)), n(String(row.alarms))]));
  const open = saved && fleet ? () => null : choose;
  buttons("robots", rows.map((row) => row.name), open, (name) => name === chosen);
  setText(byId("fleet-note"), fleet ? `${rows.length < all.length ? `${rows.length} of ` : ""}${all.length} robots, every two seconds. The rest of the page is ${chosen}.` : "");
  const cells = new Map();
  for (const row of fleet ?? []) cells.set(cellOf(row.name), [...(cells.get(cellOf(row.name)) ?? []), row]);
  byId("cells-part").hidden = cells.size < 2;
  if (cells.size < 2) return;
  const listed = [...cells].sort(([a], [b]) => a.localeCompare(b, undefined, { numeric: true }));
  fillRows(byId("cells"), listed.map(([name, own]) => [name || "without", n(String(own.length)), n(String(own.filter((row) => row.stale).length)),
    n(watts(total(own, powerOf))), n(watts(total(own, (row) => row.measured_power))), n(energy(total(own, (row) => row.energy))), n(String(total(own, (row) => row.alarms)))]));
  buttons("cells", listed.map(([name]) => name || "without"), (name) => {
    const search = byId("robot-search");
    search.value = search.value === name || name === "without" ? "" : name;
    search.dispatchEvent(new Event("input"));
  }, (name) => name === byId("robot-search").value);
}

// The first cell of each row as a button; one that is there stays, and so does its focus.
function buttons(table, names, open, pressed) {
  names.forEach((name, place) => {
    const cell = byId(table).tBodies[0].rows[place].cells[0];
    let button = cell.querySelector("button");
    if (!button) {
      button = element("button", { type: "button", class: "plain" }, name);
      cell.replaceChildren(button);
    }
    button.onclick = () => open(name);
    button.setAttribute("aria-pressed", String(pressed(name)));
  });
}
