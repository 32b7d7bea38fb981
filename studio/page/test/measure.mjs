// Measures what the studio takes: `node test/measure.mjs ROOT DIST`.
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { gzipSync } from "node:zlib";
import { instance, moduleOf, texts } from "./engine.mjs";

const [root, dist] = process.argv.slice(2);
const packed = (name) => gzipSync(readFileSync(join(dist, name)), { level: 9 }).length;
const module_bytes = readFileSync(join(dist, "engine.wasm.gz")).length;
const script_bytes = ["studio.js", "worker.js", "studio.css", "index.html"].map(packed).reduce((a, b) => a + b);
const files = texts(join(root, "missions"), ".esm");
const world = readFileSync(join(root, "missions/worlds/office.world"), "utf8");
const module = await moduleOf(dist);

const runs = [];
for (let round = 0; round < 5; round++) {
  const call = instance(module);
  call({ call: "files", files });
  call({ call: "start", path: "/missions/patrol.esm", world, seed: 1, until_us: 120e6 });
  const begun = performance.now();
  call({ call: "go_on", to_us: 130e6 });
  runs.push(performance.now() - begun);
}
const call = instance(module);
call({ call: "files", files });
const uri = "file:///missions/patrol.esm";
const text = files["/missions/patrol.esm"];
const serve = (...messages) => call({ call: "serve", now_ms: performance.now(), messages: messages.map((it) => ({ jsonrpc: "2.0", ...it })) });
serve({ id: 0, method: "initialize", params: { rootUri: "file:///", capabilities: {} } }, { method: "initialized", params: {} });
serve({ method: "textDocument/didOpen", params: { textDocument: { uri, languageId: "esm", version: 0, text } } });
const keys = [];
for (let version = 1; version <= 60; version++) {
  const changed = `${text}\n// ${"x".repeat(version)}`;
  const begun = performance.now();
  const answer = serve({ method: "textDocument/didChange", params: { textDocument: { uri, version }, contentChanges: [{ text: changed }] } });
  call({ call: "files", files: { ...files, "/missions/patrol.esm": changed } });
  call({ call: "draw", path: "/missions/patrol.esm" });
  keys.push(performance.now() - begun);
  if (!answer.messages.some((it) => it.method === "textDocument/publishDiagnostics")) throw new Error("no diagnostics");
}
const at = (list, part) => [...list].sort((a, b) => a - b)[Math.floor(part * (list.length - 1))];
console.log(JSON.stringify({
  module_bytes, script_bytes, page_bytes: module_bytes + script_bytes,
  patrol_120_s_ms: Math.round(Math.min(...runs)), key_to_picture_p95_ms: Math.round(at(keys, 0.95)),
}));
