// Figures from the monitor: the state once, then a stream of events that mends itself.
import { ask } from "./access.js";

const SILENCE = 2500; // without any event the stream is begun again [ms]
const WAITS = [300, 600, 1200, 2500];

let reading = null; // what ends the stream that is read

// Of many robots the monitor sends one whole: that of this name, or the first.
const of = (name) => (name ? `?robot=${encodeURIComponent(name)}` : "");
export const fetchState = async (name) => (await ask(`api/state${of(name)}`, { signal: AbortSignal.timeout(5000) })).json();
export const fetchSaved = async (name) => (await ask(`saved.html${of(name)}`)).blob();
export const restart = () => reading?.abort("restart");

export async function act(robot, action, text) {
  try {
    const answer = await ask("api/control", {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ robot, action, text }),
    });
    return answer.json();
  } catch (error) {
    if (error.message === "token" || error instanceof TypeError) throw error;
    return { done: false, message: error.message };
  }
}

async function readEvents(handle) {
  const abort = new AbortController();
  reading = abort;
  let alarm = setTimeout(() => abort.abort(), 2 * SILENCE);
  // A page that is left may live on in the cache of the browser: it keeps no connection.
  const leave = () => abort.abort();
  addEventListener("pagehide", leave);
  try {
    const answer = await ask(`api/events${of(handle.shown())}`, { signal: abort.signal });
    const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
    let rest = "";
    for (;;) {
      const { value, done } = await reader.read();
      if (done) return;
      clearTimeout(alarm);
      alarm = setTimeout(() => abort.abort(), SILENCE);
      const blocks = (rest + value).split("\n\n");
      rest = blocks.pop();
      for (const block of blocks) {
        const event = /^event: (\w+)\ndata: (.*)$/s.exec(block);
        if (event) handle[event[1]]?.(JSON.parse(event[2]));
      }
    }
  } finally {
    removeEventListener("pagehide", leave);
    clearTimeout(alarm);
    abort.abort();
  }
}

// Keeps the page up to date for ever: `handle` has shown, begin, state, fleet, power, lost and refused.
export async function follow(handle) {
  for (let attempt = 0; ; attempt += 1) {
    try {
      handle.begin(await fetchState(handle.shown()));
      attempt = 0;
      await readEvents(handle);
      handle.lost();
    } catch (error) {
      if (error === "restart") continue;
      if (error.message === "token") {
        handle.lost();
        await handle.refused();
      } else {
        handle.lost(error);
      }
    }
    await new Promise((go) => setTimeout(go, WAITS[Math.min(attempt, WAITS.length - 1)]));
  }
}
