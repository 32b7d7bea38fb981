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
const serve = (...messages) => call({ call: "serve", now_ms: performance.now(), messages: messages.map((it) => ({ jsonrpc: "2.0", ...it })) });
serve({ id: 0, method: "initialize", params: { rootUri: "file:///", capabilities: {} } }, { method: "initialized", params: {} });
/** A machine of 500 states in 50 regions. */
function large() {
  const regions = Array.from({ length: 50 }, (_, region) => {
    const states = Array.from({ length: 10 }, (_, state) => `state S${state} timeout 1 s;`).join(" ");
    const ways = Array.from({ length: 10 }, (_, state) => `S${state} -> S${(state + 1) % 10} [timeout];`).join(" ");
    return `region r${region} { ${states} initial -> S0; ${ways} }`;
  });
  return `interpreter slot 1;\nslot 1 period 20 ms duration 10 ms;\nmachine Large {\n${regions.join("\n")}\n}\n`;
}

/** From a key press to diagnostics and picture, in milliseconds, of each of some key presses. */
function keyPresses(path, text, count) {
  const uri = `file://${path}`;
  serve({ method: "textDocument/didOpen", params: { textDocument: { uri, languageId: "esm", version: 0, text } } });
  const times = [];
  for (let version = 1; version <= count; version++) {
    const changed = `${text}\n// ${"x".repeat(version)}`;
    const begun = performance.now();
    const answer = serve({ method: "textDocument/didChange", params: { textDocument: { uri, version }, contentChanges: [{ text: changed }] } });
    call({ call: "files", files: { ...files, [path]: changed } });
    const drawn = call({ call: "draw", path });
    times.push(performance.now() - begun);
    const isTold = answer.messages.some((it) => it.method === "textDocument/publishDiagnostics");
    if (!isTold || !drawn.svg) throw new Error(`${path}: no diagnostics, or no picture: ${drawn.reason}`);
  }
  serve({ method: "textDocument/didClose", params: { textDocument: { uri } } });
  return times;
}
const at = (list, part) => [...list].sort((a, b) => a - b)[Math.floor(part * (list.length - 1))];
console.log(JSON.stringify({
  module_bytes, script_bytes, page_bytes: module_bytes + script_bytes,
  patrol_120_s_ms: Math.round(Math.min(...runs)), key_to_picture_p95_ms: Math.round(at(keyPresses("/missions/patrol.esm", files["/missions/patrol.esm"], 60), 0.95)),
  key_to_picture_of_500_states_p95_ms: Math.round(at(keyPresses("/missions/large.esm", large(), 40), 0.95)),
}));
