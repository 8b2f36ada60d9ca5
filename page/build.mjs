/** Bundles src/ with its libraries into bundle/: one script, one style sheet, the libraries' licences, and what it was made of.
 *
 *     make page-bundle
 */

import { createHash } from "node:crypto";
import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const LIBRARIES = ["three", "uplot"];
const SOURCES = ["build.mjs", "package.json", "package-lock.json", "tsconfig.json", ...readdirSync("src").sort().map((name) => `src/${name}`)];

const digest = (content) => createHash("sha256").update(content).digest("hex");

await build({
  entryPoints: { report: "src/main.ts" },
  outdir: "bundle",
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "ascii",
  legalComments: "eof",
  logLevel: "warning",
});

const versions = {};
for (const library of LIBRARIES) {
  versions[library] = JSON.parse(readFileSync(`node_modules/${library}/package.json`, "utf8")).version;
  writeFileSync(`bundle/LICENSE-${library}.txt`, readFileSync(`node_modules/${library}/LICENSE`));
}

const made = ["report.js", "report.css", ...LIBRARIES.map((library) => `LICENSE-${library}.txt`)];
const facts = {
  command: "make page-bundle",
  libraries: versions,
  bundler: `esbuild ${JSON.parse(readFileSync("node_modules/esbuild/package.json", "utf8")).version}`,
  sources: Object.fromEntries(SOURCES.map((name) => [name, digest(readFileSync(name))])),
  files: Object.fromEntries(made.map((name) => [name, digest(readFileSync(`bundle/${name}`))])),
};
writeFileSync("bundle/bundle.json", `${JSON.stringify(facts, null, 2)}\n`);
