// Builds the explorer into the Python package (scripts, one style sheet, the page, and the licences of what is in them), and
// the scripts of the pages that cornerforge writes.
// node build.mjs [--watch]
import { build, context } from "esbuild";
import { cp, mkdir, rm, writeFile } from "node:fs/promises";
import { TEMPLATES, pageScripts } from "./pages.mjs";

const out = "../src/cornerforge/explorer/static";
const options = {
  entryPoints: { explorer: "src/explorer/main.tsx" },
  outdir: out,
  bundle: true,
  minify: true,
  format: "esm",
  splitting: true, // what is needed later, as the 3-D view, is a script of its own
  chunkNames: "[name]-[hash]",
  target: "es2022",
  jsx: "automatic",
  jsxImportSource: "preact",
  legalComments: "linked",
  loader: { ".svg": "dataurl" },
};

for (const [name, text] of Object.entries(await pageScripts())) await writeFile(`${TEMPLATES}/${name}`, text);
await rm(out, { recursive: true, force: true });
await mkdir(out, { recursive: true });
await cp("src/explorer/index.html", `${out}/index.html`);
if (process.argv.includes("--watch")) await (await context(options)).watch();
else await build(options);
