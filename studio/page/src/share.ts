/** A mission in a link: its text, packed, in the part of the address that no server sees. */

import type { Plan } from "./run";

/** What is done to the robot and its world, each with its time. */
export interface Interventions {
  breaks: Plan["breaks"];
  stuck: Plan["stuck"];
  stop_at_us: number | null;
  /** Lines of the world. */
  lines: string[];
}

/** A moment of a run, with all that the run follows from. */
export interface Moment {
  t_us: number;
  until_us: number;
  /** What was done to the robot. */
  interventions: Interventions;
  /** Changed missions that took over. */
  then: { at_us: number; path: string; warm: boolean; text: string }[];
  /** The text that the run began with. */
  text: string;
}

interface Shared {
  path: string;
  text: string;
  world: string;
  moment?: Moment;
}

/** A shipped mission and its world that a link names, as those of the book do. */
export function opened(hash: string): { path: string; world: string } | null {
  const words = new URLSearchParams(hash.slice(1));
  const mission = words.get("open");
  if (!mission) return null;
  return { path: `/missions/${mission}.esm`, world: `/missions/worlds/${words.get("world") ?? "office"}.world` };
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
    return { path: shared.path, text: shared.text, world: shared.world, moment: momentOf(shared.moment) };
  } catch {
    return null;
  }
}

/** A moment that came with a link: none where it makes no sense. */
function momentOf(given: Partial<Moment> | undefined): Moment | undefined {
  const isTime = (value: unknown): value is number => typeof value === "number" && value >= 0 && Number.isFinite(value);
  if (!given || !isTime(given.t_us) || !isTime(given.until_us) || typeof given.text !== "string") return undefined;
  const { breaks, stuck, stop_at_us, lines } = given.interventions ?? {};
  if (![breaks, stuck, lines, given.then].every(Array.isArray) || !(stop_at_us === null || isTime(stop_at_us))) return undefined;
  return given as Moment;
}
