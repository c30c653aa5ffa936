// Colours: as the system, light or dark.
const THEMES = { auto: ["Auto", "as the system"], light: ["Light", "light"], dark: ["Dark", "dark"] };
const button = document.getElementById("theme");
const root = document.documentElement;

button.addEventListener("click", () => {
  const names = Object.keys(THEMES);
  const theme = names[(names.indexOf(root.dataset.theme ?? "auto") + 1) % names.length];
  if (theme === "auto") delete root.dataset.theme;
  else root.dataset.theme = theme;
  button.textContent = THEMES[theme][0];
  button.setAttribute("aria-label", `Colours: ${THEMES[theme][1]}`);
});
