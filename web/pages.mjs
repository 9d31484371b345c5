// The scripts of the pages that cornerforge writes: each one classic script, readable, of our own code only. They are
// committed, so that the pages can be written without Node; `make web` makes them again from their sources.
import { build } from "esbuild";

/** Where the Python code finds them, from this folder. */
export const TEMPLATES = "../src/cornerforge/report/templates";
/** Script of a page, and the source that it begins with. */
export const PAGES = { "report.js": "src/pages/report.ts", "comparison.js": "src/pages/comparison.ts" };

/**
 * What the sources give: the text of each script by its name.
 *
 * @returns {Promise<Record<string, string>>}
 */
export async function pageScripts() {
  const made = await Promise.all(
    Object.entries(PAGES).map(async ([name, source]) => {
      const { outputFiles, metafile } = await build({
        entryPoints: [source],
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
      if (foreign.length > 0) throw new Error(`${name} holds code that is not ours: ${foreign.join(", ")}`);
      const origin = sources.map((file) => `//   web/${file}`).join("\n");
      return [name, `// Made by \`make web\`; do not edit. Its sources:\n${origin}\n${outputFiles[0].text}`];
    }),
  );
  return Object.fromEntries(made);
}
