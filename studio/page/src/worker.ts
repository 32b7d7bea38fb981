/** A worker: one instance of the engine, one call after the other. */
import type { Call, FromWorker, ToWorker } from "./protocol";

interface Exports {
  memory: WebAssembly.Memory;
  studio_room(bytes: number): number;
  studio_call(): number;
  studio_answer(): number;
  studio_answer_bytes(): number;
}

const scope = self as unknown as {
  postMessage(message: FromWorker): void;
  onmessage: ((event: MessageEvent<ToWorker>) => void) | null;
};
let engine: Exports | undefined;
const waiting: { id: number; request: Call }[] = [];

function text(at: number, bytes: number): string {
  return new TextDecoder().decode(new Uint8Array(engine!.memory.buffer, at, bytes));
}

function carryOut(id: number, request: Call): void {
  const bytes = new TextEncoder().encode(JSON.stringify({ ...request, now_ms: performance.now() }));
  try {
    const room = engine!.studio_room(bytes.length);
    new Uint8Array(engine!.memory.buffer, room, bytes.length).set(bytes);
    const length = engine!.studio_call();
    const answer = JSON.parse(text(engine!.studio_answer(), length));
    scope.postMessage("error" in answer ? { id, error: answer.error } : { id, ok: answer.ok });
  } catch (error) {
    // A panic has ended the instance; what it said stands in the answer's place.
    let words = "";
    try {
      words = text(engine!.studio_answer(), engine!.studio_answer_bytes());
    } catch {
      // It did not come to say anything.
    }
    scope.postMessage({ id, ended: words || String(error) });
  }
}

scope.onmessage = async ({ data }) => {
  if ("module" in data) {
    const instance = await WebAssembly.instantiate(data.module, {});
    engine = instance.exports as unknown as Exports;
    for (const { id, request } of waiting.splice(0)) carryOut(id, request);
  } else if (engine) {
    carryOut(data.id, data.request);
  } else {
    waiting.push(data);
  }
};
