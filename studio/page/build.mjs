// Builds the page: `node build.mjs OUT [MODULE]`. With a module, packs the engine, too.
import { build } from "esbuild";
import { copyFileSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { gzipSync } from "node:zlib";

const [out, module] = process.argv.slice(2);
mkdirSync(out, { recursive: true });
const common = { bundle: true, minify: true, format: "esm", target: "es2022", logLevel: "warning", legalComments: "eof" };
await build({
  ...common, entryPoints: ["src/main.tsx"], outfile: `${out}/studio.js`, jsx: "automatic", jsxImportSource: "preact",
});
await build({ ...common, entryPoints: ["src/worker.ts"], outfile: `${out}/worker.js` });
await build({ ...common, entryPoints: ["src/studio.css"], outfile: `${out}/studio.css` });
copyFileSync("index.html", `${out}/index.html`);
if (module) writeFileSync(`${out}/engine.wasm.gz`, gzipSync(readFileSync(module), { level: 9 }));
