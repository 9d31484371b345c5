// The script of the pages that cornerforge writes: one classic script, readable, of our own code only. It is committed, so
// that the pages can be written without Node; `make web` makes it again from its sources.
import { build } from "esbuild";

/** Where the Python code finds it, from this folder. */
export const PAGES = "../src/cornerforge/report/templates/pages.js";

/**
 * What the sources give: the text of the script.
 *
 * @returns {Promise<string>}
 */
export async function pageScript() {
  const { outputFiles, metafile } = await build({
    entryPoints: ["src/pages/pages.ts"],
    absWorkingDir: import.meta.dirname,
    bundle: true,
    write: false,
    metafile: true,
    format: "iife",
    target: "es2022",
    charset: "utf8",
    legalComments: "none",
  });
  const sources = Object.keys(metafile.inputs).sort();
  const foreign = sources.filter((file) => !file.startsWith("src/"));
  if (foreign.length > 0) throw new Error(`the script of the pages holds code that is not ours: ${foreign.join(", ")}`);
  const origin = sources.map((file) => `//   web/${file}`).join("\n");
  return `// Made by \`make web\`; do not edit. Its sources:\n${origin}\n${outputFiles[0].text}`;
}
