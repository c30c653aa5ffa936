// Savings against a baseline (ISO 50006), and learned friction over the parts of a period.
import { byId, energy, energyParts, fillRows, known, number, percent, setText, signedPercent, DASH, JOULE_PER_WH } from "./format.js";
import { showLegend } from "./bars.js";
import { drawCurves } from "./curves.js";

const KWH = 1000 * JOULE_PER_WH;
const SHOWN = 8; // joints that have a curve
const n = (text) => ({ text, kind: "n" });
const TERMS = { constant: "each day", parts: "each part", motion_hours: "each hour in motion", on_hours: "each hour on" };
const DRIVERS = { parts: "parts", motion_hours: "hours in motion", on_hours: "hours on" };
const sure = (value, band) => `${energy(value)} ± ${energy(band)}`;
const digitsOf = (most) => (most >= 20 ? 0 : most >= 2 ? 1 : most >= 0.2 ? 2 : 4);

// The form as the address has it; else the 60 days before the period, which begins on a day.
export function fillBaseline(params, first) {
  const before = (day, days) => new Date(Date.parse(`${day}T00:00:00Z`) - 86400000 * days).toISOString().slice(0, 10);
  byId("baseline-start").value = params.get("baseline_start") || before(first, 60);
  byId("baseline-stop").value = before(params.get("baseline_stop") || first, 1);
  const asked = params.has("baseline_start");
  for (const box of document.querySelectorAll("[data-driver]")) box.checked = asked ? params.getAll("driver").includes(box.dataset.driver) : box.dataset.driver === "parts";
  byId("baseline-measured").checked = params.get("measured") === "1";
}

// What the form asks for, as the address names it.
export function baselineOf() {
  const stop = new Date(`${byId("baseline-stop").value}T00:00:00Z`);
  stop.setUTCDate(stop.getUTCDate() + 1);
  return {
    baseline_start: byId("baseline-start").value, baseline_stop: stop.toISOString().slice(0, 10),
    driver: [...document.querySelectorAll("[data-driver]")].filter((box) => box.checked).map((box) => box.dataset.driver),
    measured: byId("baseline-measured").checked ? "1" : "",
  };
}

export function showSavings(answer, open, choose, links) {
  const { rows, one, left_out: out } = answer;
  byId("savings").hidden = false;
  const [first] = rows;
  const whose = answer.measured ? "measured" : "predicted";
  setText(byId("saved"), !first ? "No robot can be compared." : rows.length > 1 ? `${rows.filter((row) => row.claimed).length} of ${rows.length} robots saved surely`
    : `${first.claimed ? "A saving" : first.saved > 0 ? "Not certain to be a saving" : "No saving"}: ${sure(first.saved, first.band)} of ${energy(first.expected)} expected (${signedPercent(first.saved / first.expected)} ± ${percent(first.band / first.expected)})`);
  setText(byId("saved-note"), `${answer.reported} against ${answer.baseline}, ${whose} energy${answer.drivers.length ? `, explained by ${answer.drivers.map((name) => DRIVERS[name]).join(", ")}` : ", a mean of all days"}. ± is a 90 % band; a saving is claimed where the 99.8 % band lies above zero.`);
  fillRows(byId("saving-robots"), rows.map((row) => ["", n(energy(row.saved)), n(`± ${energy(row.band)}`), n(signedPercent(row.saved / row.expected)), row.claimed ? "yes" : "no", n(percent(row.cv_rmse)), n(energy(row.per_part)), n(known(row.change) ? `${signedPercent(row.change)} ± ${percent(row.change_band)}` : DASH)]));
  links("saving-robots", rows.map((row) => row.robot), choose);
  setText(byId("saving-left"), out.length ? `Not compared: ${out.slice(0, 3).map((row) => `${row.robot} (${row.why})`).join("; ")}${out.length > 3 ? ` and ${out.length - 3} more` : ""}.` : "");
  byId("saving-days").hidden = !one;
  if (one) showDays(one, first, open, links);
}

function showDays(one, total, open, links) {
  const { days } = one;
  const [, unit] = energyParts(Math.max(...days.map((day) => Math.abs(day.saved) + day.band)));
  const scale = unit === "kWh" ? KWH : JOULE_PER_WH;
  const most = Math.max(...days.map((day) => Math.abs(day.saved) + day.band)) / scale;
  const hint = "Point at a day, or use the arrow keys, to read it.";
  drawCurves(byId("cusum"), byId("cusum-note"), {
    title: `Saved up to the end of each day, ${sure(total.saved, total.band)} at the end`, places: days, unit, level: 0, digits: digitsOf(most), hint,
    series: [{ name: "saved", kind: "s3", values: days.map((day) => day.saved / scale), low: days.map((day) => (day.saved - day.band) / scale), high: days.map((day) => (day.saved + day.band) / scale) }],
    read: (place) => `${days[place].name}: used ${energy(days[place].energy)}, expected ${energy(days[place].expected)}; saved up to its end ${sure(days[place].saved, days[place].band)}`,
  });
  const parts = days.filter((day) => known(day.per_part));
  byId("per-part-figure").hidden = !parts.length;
  if (parts.length) {
    const largest = Math.max(...parts.map((day) => day.per_part));
    const own = energyParts(largest)[1] === "kWh" ? ["kWh", KWH] : ["Wh", JOULE_PER_WH];
    const values = days.map((day) => (known(day.per_part) ? day.per_part / own[1] : null));
    drawCurves(byId("per-part"), byId("per-part-note"), {
      title: `Energy per part of each day, ${energy(total.per_part ?? parts[0].per_part)} in the mean`, places: days, unit: own[0], hint: known(total.change)
        ? `${energy(total.per_part)} per part in the mean; its trend over these days ${signedPercent(total.change)} ± ${percent(total.change_band)}.` : "Too few days with parts for a trend.",
      level: null, digits: digitsOf(largest / own[1] / 4), series: [{ name: "per part", kind: "s0", values }],
      read: (place) => `${days[place].name}: ${known(days[place].per_part) ? `${energy(days[place].per_part)} per part, ${number(days[place].parts)} parts` : "no part"}`,
    });
  }
  fillRows(byId("saving-terms"), one.terms.map((term) => [TERMS[term.name] ?? term.name, n(energy(term.value)), n(`± ${energy(term.band)}`)]));
  setText(byId("saving-model"), `Baseline of ${one.baseline_days} days, CV(RMSE) ${percent(total.cv_rmse)}: days scatter by ${energy(one.scatter)}. ${one.notes.map((note) => `${note}. `).join("")}`);
  fillRows(byId("deviations"), one.deviations.map((day) => ["", n(energy(day.energy)), n(energy(day.expected)), n(energy(day.energy - day.expected)), n(known(day.deviation) ? number(day.deviation, 1) : DASH), n(number(day.parts))]));
  links("deviations", one.deviations.map((day) => day.name), (_, place) => open(one.deviations[place].zoom));
}

export function showFriction(answer, alone) {
  const { rows, parts, count } = answer;
  byId("friction-card").hidden = !rows.length;
  if (!rows.length) return;
  const drawnRows = alone ? rows.slice(0, SHOWN) : [];
  const models = new Set(rows.map((row) => `${row.robot} ${row.model}`)).size > new Set(rows.map((row) => row.robot)).size;
  byId("friction").hidden = !drawnRows.length || parts.length < 2;
  showLegend(byId("friction-legend"), drawnRows.map((row, index) => [`part s${index}`, row.joint]));
  if (!byId("friction").hidden) {
    drawCurves(byId("friction"), byId("friction-note"), {
      title: `Learned friction of ${drawnRows.length} joints over that of the model file`, places: parts, unit: "ratio", level: 1, digits: 2,
      series: drawnRows.map((row, index) => ({ name: row.joint, kind: `s${index}`, values: row.values })),
      read: (place) => `${parts[place].name}: ${drawnRows.map((row) => `${row.joint} ${known(row.values[place]) ? number(row.values[place], 3) : DASH}`).join(", ")}`,
      hint: "Measured friction over that of the model file; 1 is as identified.",
    });
  } else setText(byId("friction-note"), "Measured friction over that of the model file; 1 is as identified. Choose one robot and a week or more for curves.");
  fillRows(byId("friction-joints"), rows.map((row) => [row.joint, row.robot, n(number(row.first, 3)), n(number(row.last, 3)), n(signedPercent(row.last / row.first - 1)), n(String(row.days)), ...(models ? [row.model.slice(0, 8)] : [])]));
  byId("friction-model").hidden = !models;
  setText(byId("friction-count"), `${count > rows.length ? `${rows.length} of ${count} joints shown, the largest changes first. ` : ""}${models ? "Ratios of two model files cannot be compared. " : ""}`);
}
