// Requests to the monitor, with its token where there is one.
let token = new URLSearchParams(location.hash.slice(1)).get("token") ?? "";

export function setToken(value) {
  token = value.trim();
}

// The token as the end of an address: browsers do not send it to the server.
export const tokenHash = () => (token ? `#token=${encodeURIComponent(token)}` : "");

export async function ask(path, { headers = {}, ...options } = {}) {
  const own = token ? { Authorization: `Bearer ${token}` } : {};
  const answer = await fetch(path, { ...options, headers: { ...headers, ...own } });
  if (answer.status === 401) throw new Error("token");
  if (!answer.ok) throw new Error(await answer.text());
  return answer;
}

// Offer text or a file to be kept.
export function keep(blob, name) {
  const url = URL.createObjectURL(blob);
  const link = document.createElement("a");
  Object.assign(link, { href: url, download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 1000);
}
