// The engine without a page: what tests and measurements call.
import { readdirSync, readFileSync } from "node:fs";
import { join, relative, sep } from "node:path";
import { gunzipSync } from "node:zlib";

/** The module that is in the page. */
export async function moduleOf(dist) {
  return WebAssembly.compile(gunzipSync(readFileSync(join(dist, "engine.wasm.gz"))));
}

/** A new instance: a function that calls it. */
export function instance(module) {
  const engine = new WebAssembly.Instance(module, {}).exports;
  const text = (at, bytes) => new TextDecoder().decode(new Uint8Array(engine.memory.buffer, at, bytes));
  return (request, attached = null) => {
    const words = new TextEncoder().encode(JSON.stringify(request));
    const bytes = attached ? Buffer.concat([words, Buffer.from([0]), attached]) : words;
    const room = engine.studio_room(bytes.length);
    new Uint8Array(engine.memory.buffer, room, bytes.length).set(bytes);
    let length;
    try {
      length = engine.studio_call();
    } catch (error) {
      throw new Error(`the instance has ended: ${text(engine.studio_answer(), engine.studio_answer_bytes())} (${error})`);
    }
    const answer = JSON.parse(text(engine.studio_answer(), length));
    if ("error" in answer) throw new Error(answer.error);
    return answer.ok;
  };
}

/** Texts below a folder, by their paths in the page. */
export function texts(folder, ending) {
  const found = {};
  for (const entry of readdirSync(folder, { recursive: true, withFileTypes: true })) {
    if (!entry.isFile() || !entry.name.endsWith(ending)) continue;
    const path = join(entry.parentPath ?? entry.path, entry.name);
    found["/missions/" + relative(folder, path).split(sep).join("/")] = readFileSync(path, "utf8");
  }
  return found;
}
