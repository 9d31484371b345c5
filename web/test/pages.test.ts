import { expect, test } from "vitest";
import { PAGES, pageScripts } from "../pages.mjs";

const committed = import.meta.glob<string>("../../src/cornerforge/report/templates/*.js", { query: "?raw", import: "default", eager: true });
const byName = Object.fromEntries(Object.entries(committed).map(([path, text]) => [path.split("/").at(-1)!, text]));

test("the committed scripts are what their sources give: run `make web`", async () => {
  const made = await pageScripts();
  expect(Object.keys(byName).sort()).toEqual(Object.keys(PAGES).sort());
  for (const [name, text] of Object.entries(made)) expect(byName[name], name).toBe(text);
});

test("nothing in them ends a script of the page early", async () => {
  for (const text of Object.values(byName)) expect(text).not.toMatch(/<\/script|<!--/i);
});
