// Light or dark: as the system says, until the user chooses.
import { computed, effect, signal } from "@preact/signals";
import { dark as system } from "../shared/colours";

export type Theme = "system" | "light" | "dark";

const systemDark = signal(system.matches);
system.addEventListener("change", () => (systemDark.value = system.matches));

function remembered(): Theme {
  try {
    const said = localStorage.getItem("theme");
    return said === "light" || said === "dark" ? said : "system";
  } catch {
    return "system";
  }
}

export const theme = signal<Theme>(remembered());
export const dark = computed(() => (theme.value === "system" ? systemDark.value : theme.value === "dark"));

effect(() => {
  const root = document.documentElement;
  if (theme.value === "system") delete root.dataset.theme;
  else root.dataset.theme = theme.value;
  // Pictures that read colours from the style sheet read them again.
  queueMicrotask(() => system.dispatchEvent(new Event("change")));
  try {
    if (theme.value === "system") localStorage.removeItem("theme");
    else localStorage.setItem("theme", theme.value);
  } catch {
    // The browser keeps nothing: the choice holds until the page is closed.
  }
});

/** To the other of the two that is not shown now. */
export function toggleTheme(): void {
  const wanted = dark.peek() ? "light" : "dark";
  theme.value = (wanted === "dark") === systemDark.peek() ? "system" : wanted;
}
