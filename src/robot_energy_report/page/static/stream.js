// Figures from the monitor: the state once, then a stream of events that mends itself.
const SILENCE = 2500; // without any event the stream is begun again [ms]
const WAITS = [300, 600, 1200, 2500];
let token = new URLSearchParams(location.hash.slice(1)).get("token") ?? "";

export function setToken(value) {
  token = value.trim();
}

function headers() {
  return token ? { Authorization: `Bearer ${token}` } : {};
}

export async function fetchState() {
  const answer = await fetch("api/state", { headers: headers(), signal: AbortSignal.timeout(5000) });
  if (answer.status === 401) throw new Error("token");
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

export async function fetchSaved() {
  const answer = await fetch("saved.html", { headers: headers() });
  if (!answer.ok) throw new Error(await answer.text());
  return answer.blob();
}

export async function act(robot, action, text) {
  const answer = await fetch("api/control", {
    method: "POST", headers: { ...headers(), "Content-Type": "application/json" },
    body: JSON.stringify({ robot, action, text }),
  });
  if (answer.status === 401) throw new Error("token");
  if (!answer.ok) return { done: false, message: await answer.text() };
  return answer.json();
}

async function readEvents(handle) {
  const abort = new AbortController();
  let alarm = setTimeout(() => abort.abort(), 2 * SILENCE);
  // A page that is left may live on in the cache of the browser: it keeps no connection.
  const leave = () => abort.abort();
  addEventListener("pagehide", leave);
  try {
    const answer = await fetch("api/events", { headers: headers(), signal: abort.signal });
    if (answer.status === 401) throw new Error("token");
    if (!answer.ok) throw new Error(await answer.text());
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

// Keeps the page up to date for ever: `handle` has begin, state, power, lost and refused.
export async function follow(handle) {
  for (let attempt = 0; ; attempt += 1) {
    try {
      handle.begin(await fetchState());
      attempt = 0;
      await readEvents(handle);
      handle.lost();
    } catch (error) {
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
