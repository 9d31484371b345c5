// Builds the explorer into the Python package (scripts, one style sheet, the page, and the licences of what is in them), and
// the script of the pages that cornerforge writes.
// node build.mjs [--watch]
import { build, context } from "esbuild";
import { cp, mkdir, readFile, rm, writeFile } from "node:fs/promises";
import { PAGES, pageScript } from "./pages.mjs";

const out = "../src/cornerforge/ext/explorer/static";
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
  legalComments: "none", // the whole licences are in LICENSES.txt
  metafile: true,
  loader: { ".svg": "dataurl" },
};

await writeFile(PAGES, await pageScript());
await rm(out, { recursive: true, force: true });
await mkdir(out, { recursive: true });
if (process.argv.includes("--watch")) await (await context(options)).watch();
else await writeFile(`${out}/LICENSES.txt`, await licences((await build(options)).metafile));
await cp("src/explorer/index.html", `${out}/index.html`); // last: make takes it as the sign that all is there

// The licences of the packages that are in the scripts and the style sheet, one after the other.
async function licences(metafile) {
  const inputs = Object.values(metafile.outputs).flatMap((one) => Object.keys(one.inputs));
  const names = new Set(inputs.map((path) => path.match(/node_modules\/((?:@[^/]+\/)?[^/]+)\//)?.[1]).filter(Boolean));
  const texts = [...names].sort().map(async (name) => {
    const { version } = JSON.parse(await readFile(`node_modules/${name}/package.json`, "utf8"));
    return `${name} ${version}\n\n${await readFile(`node_modules/${name}/LICENSE`, "utf8")}`;
  });
  return (await Promise.all(texts)).join(`\n${"-".repeat(80)}\n\n`);
}
