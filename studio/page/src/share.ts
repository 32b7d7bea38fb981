/** A mission in a link: its text, packed, in the part of the address that no server sees. */

interface Shared {
  path: string;
  text: string;
  world: string;
}

async function piped(bytes: Uint8Array<ArrayBuffer>, through: TransformStream): Promise<Uint8Array<ArrayBuffer>> {
  const stream = new Blob([bytes]).stream().pipeThrough(through);
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** The largest text that a link may unpack to, in bytes. */
const LIMIT = 1_000_000;

export async function pack(shared: Shared): Promise<string> {
  const bytes = new TextEncoder().encode(JSON.stringify(shared));
  const packed = await piped(bytes, new CompressionStream("deflate-raw"));
  let text = "";
  for (const byte of packed) text += String.fromCharCode(byte);
  return "#m=" + btoa(text).replace(/\+/g, "-").replace(/\//g, "_").replace(/=+$/, "");
}

export async function unpack(hash: string): Promise<Shared | null> {
  if (!hash.startsWith("#m=")) return null;
  try {
    const text = atob(hash.slice(3).replace(/-/g, "+").replace(/_/g, "/"));
    const packed = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
    const bytes = await piped(packed, new DecompressionStream("deflate-raw"));
    if (bytes.length > LIMIT) return null;
    const shared = JSON.parse(new TextDecoder().decode(bytes));
    const isText = (value: unknown) => typeof value === "string";
    if (!isText(shared.path) || !isText(shared.text) || !isText(shared.world)) return null;
    return { path: shared.path, text: shared.text, world: shared.world };
  } catch {
    return null;
  }
}
