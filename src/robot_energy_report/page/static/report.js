// Draws the energy flows of a report, again when its width changes.
import "./theme.js";
import { drawFlow } from "./flow.js";

const hosts = [...document.querySelectorAll("[data-flow]")];
const drawAll = () => hosts.forEach((host) => drawFlow(host, JSON.parse(host.dataset.flow), true));
let drawnWidth = innerWidth;
addEventListener("resize", () => { if (innerWidth !== drawnWidth) { drawnWidth = innerWidth; drawAll(); } });
drawAll();
