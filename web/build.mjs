// Builds the explorer into the Python package: one script, one style sheet, the page, and the licences of what is in them.
// node build.mjs [--watch]
import { build, context } from "esbuild";
import { cp, mkdir, rm } from "node:fs/promises";

const out = "../src/cornerforge/explorer/static";
const options = {
  entryPoints: { explorer: "src/explorer/main.tsx" },
  outdir: out,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  jsx: "automatic",
  jsxImportSource: "preact",
  legalComments: "linked",
  loader: { ".svg": "dataurl" },
};

await rm(out, { recursive: true, force: true });
await mkdir(out, { recursive: true });
await cp("src/explorer/index.html", `${out}/index.html`);
if (process.argv.includes("--watch")) await (await context(options)).watch();
else await build(options);
