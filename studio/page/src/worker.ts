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
const waiting: { id: number; request: Call; bytes?: Uint8Array }[] = [];

function text(at: number, bytes: number): string {
  return new TextDecoder().decode(new Uint8Array(engine!.memory.buffer, at, bytes));
}

function carryOut(id: number, request: Call, attached?: Uint8Array): void {
  const text_bytes = new TextEncoder().encode(JSON.stringify({ ...request, now_ms: performance.now() }));
  const length = text_bytes.length + (attached ? 1 + attached.length : 0);
  try {
    const room = engine!.studio_room(length);
    const place = new Uint8Array(engine!.memory.buffer, room, length);
    place.set(text_bytes);
    // Behind a zero, which is in no JSON.
    if (attached) place.set(attached, text_bytes.length + 1);
    const answered = engine!.studio_call();
    const answer = JSON.parse(text(engine!.studio_answer(), answered));
    scope.postMessage("error" in answer ? { id, error: answer.error } : { id, ok: answer.ok });
  } catch (error) {
    tellEnd(id, error);
  }
}

/** Says that the instance has ended: what a panic said stands in the answer's place. */
function tellEnd(id: number, error: unknown): void {
  let words = "";
  try {
    words = text(engine!.studio_answer(), engine!.studio_answer_bytes());
  } catch {
    // It did not come to say anything.
  }
  scope.postMessage({ id, ended: words || String(error) });
}

scope.onmessage = async ({ data }) => {
  if ("module" in data) {
    const instance = await WebAssembly.instantiate(data.module, {});
    engine = instance.exports as unknown as Exports;
    for (const { id, request, bytes } of waiting.splice(0)) carryOut(id, request, bytes);
  } else if (engine) {
    carryOut(data.id, data.request, data.bytes);
  } else {
    waiting.push(data);
  }
};
