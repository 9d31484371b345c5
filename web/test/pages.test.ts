import { expect, test } from "vitest";
import { pageScript } from "../pages.mjs";
import committed from "../../src/cornerforge/report/templates/pages.js?raw";

test("the committed script is what its sources give: run `make web`", async () => {
  expect(committed).toBe(await pageScript());
});

test("nothing in it ends a script of the page early", () => {
  expect(committed).not.toMatch(/<\/script|<!--/i);
});
