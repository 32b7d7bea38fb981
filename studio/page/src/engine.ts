/** The page's side of the engine: workers that are called, and started again when they end. */
import type { Call, FromWorker } from "./protocol";

let module: Promise<WebAssembly.Module> | undefined;

/** The first bytes of what is packed. */
const PACKED = [0x1f, 0x8b];

/** What a stream begins with, and all of it. */
async function begun(stream: ReadableStream<Uint8Array<ArrayBuffer>>): Promise<[Uint8Array, ReadableStream<Uint8Array<ArrayBuffer>>]> {
  const reader = stream.getReader();
  const first = await reader.read();
  const whole = new ReadableStream<Uint8Array<ArrayBuffer>>({
    start: (to) => (first.value ? to.enqueue(first.value) : to.close()),
    async pull(to) {
      const next = await reader.read();
      if (next.value) to.enqueue(next.value);
      else to.close();
    },
  });
  return [first.value ?? new Uint8Array(), whole];
}

/** The engine's module, compiled while it comes. It is kept packed, so that any static server will do. */
function compiled(): Promise<WebAssembly.Module> {
  module ??= (async () => {
    const answer = await fetch("engine.wasm.gz");
    if (!answer.ok || !answer.body) throw new Error(`engine.wasm.gz: ${answer.status}`);
    const [first, whole] = await begun(answer.body);
    const isPacked = PACKED.every((byte, place) => first[place] === byte);
    const stream = isPacked ? whole.pipeThrough(new DecompressionStream("gzip")) : whole;
    return WebAssembly.compileStreaming(new Response(stream, { headers: { "Content-Type": "application/wasm" } }));
  })();
  return module;
}

/** What the engine refuses, in its words. */
export class Refused extends Error {}

/** A worker with an instance. */
export class Engine {
  private worker!: Worker;
  private open = new Map<number, { done: (value: never) => void; failed: (error: Error) => void }>();
  private next = 0;

  /** `ended` hears when the instance has ended and another one was started. */
  constructor(private ended: (words: string) => void) {
    this.start();
  }

  private start(): void {
    this.worker = new Worker(new URL("worker.js", document.baseURI), { type: "module" });
    this.worker.onmessage = ({ data }: MessageEvent<FromWorker>) => this.hear(data);
    const worker = this.worker;
    compiled().then(
      (module) => worker.postMessage({ module }),
      (error) => {
        this.stop(String(error));
        this.ended(String(error));
      },
    );
  }

  private hear(answer: FromWorker): void {
    const open = this.open.get(answer.id);
    this.open.delete(answer.id);
    if ("ok" in answer) open?.done(answer.ok as never);
    else if ("error" in answer) open?.failed(new Refused(answer.error));
    else {
      open?.failed(new Refused(answer.ended));
      this.stop(answer.ended);
      // Whoever hears of it calls the next instance.
      this.start();
      this.ended(answer.ended);
    }
  }

  private stop(words: string): void {
    this.worker.terminate();
    for (const { failed } of this.open.values()) failed(new Refused(words));
    this.open.clear();
  }

  /** Calls it; bytes may come with the request. */
  call<T>(request: Call, bytes?: Uint8Array): Promise<T> {
    const id = this.next++;
    return new Promise<T>((done, failed) => {
      this.open.set(id, { done: done as (value: never) => void, failed });
      this.worker.postMessage({ id, request, bytes });
    });
  }

  /** Lets go of the instance and its memory. */
  close(): void {
    this.stop("closed");
  }
}
