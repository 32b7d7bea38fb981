// Builds the page: `node build.mjs OUT [MODULE]`. With a module, packs the engine, too.
import { build } from "esbuild";
import { copyFileSync, mkdirSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { gzipSync } from "node:zlib";

const [out, module] = process.argv.slice(2);
mkdirSync(out, { recursive: true });
const common = {
  bundle: true, minify: true, format: "esm", target: "es2022", logLevel: "warning", legalComments: "eof", metafile: true,
};
const built = [
  await build({
    ...common, entryPoints: ["src/main.tsx"], outfile: `${out}/studio.js`, jsx: "automatic", jsxImportSource: "preact",
  }),
  await build({ ...common, entryPoints: ["src/worker.ts"], outfile: `${out}/worker.js` }),
  await build({ ...common, entryPoints: ["src/studio.css"], outfile: `${out}/studio.css` }),
];
copyFileSync("index.html", `${out}/index.html`);
writeFileSync(`${out}/licenses.txt`, licenses(built.flatMap((it) => Object.keys(it.metafile.inputs))));
if (module) writeFileSync(`${out}/engine.wasm.gz`, gzipSync(readFileSync(module), { level: 9 }));

/** The licences of the packages that these files are from, which go where the page goes. */
function licenses(files) {
  const names = files.map((file) => file.match(/^node_modules\/((?:@[^/]+\/)?[^/]+)\//)?.[1]).filter(Boolean);
  const packages = [...new Set(names)].sort();
  const parts = packages.map((name) => {
    const folder = `node_modules/${name}`;
    const { version, license } = JSON.parse(readFileSync(`${folder}/package.json`, "utf8"));
    const file = readdirSync(folder).find((it) => /^licen[cs]e/i.test(it));
    if (!file) throw new Error(`${name} has no file with its licence`);
    return `${name} ${version}, ${license}\n\n${readFileSync(`${folder}/${file}`, "utf8").trim()}\n`;
  });
  return `What the studio's page is made of, beside its own sources.\n\n${parts.join(`\n${"-".repeat(80)}\n\n`)}`;
}
