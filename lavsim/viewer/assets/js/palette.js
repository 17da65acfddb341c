// The colours of the theme that is on, and what the page is told about themes.

export const THEMES = ["auto", "light", "dark"];

/** Puts a theme on. */
export function applyTheme(theme) {
  const isDark = theme === "dark" || (theme === "auto" && matchMedia("(prefers-color-scheme: dark)").matches);
  document.documentElement.dataset.theme = isDark ? "dark" : "light";
  document.getElementById("theme").setAttribute("aria-label", `Theme: ${theme}`);
}

/** Colours by name, as the style has them. */
export function paletteOf() {
  const style = getComputedStyle(document.documentElement);
  const palette = {};
  for (const name of ["page", "card", "text", "soft", "accent", "mark", "mark-text", "warn", "good", "land", "median", "walk", "shoulder",
    "parking", "road", "white", "yellow", "curb", "building", "building-edge", "wall", "tree", "pole", "route", "trail", "ink", "halo",
    "chart", "chart-back", "grid", "car", "van", "truck", "bus", "motorcycle", "bicycle", "walker", "prop", "ego", "scenario", "plan",
    "forecast", "inner"]) {
    palette[name.replace(/-(.)/g, (_, letter) => letter.toUpperCase())] = style.getPropertyValue(`--${name}`).trim();
  }
  return palette;
}
