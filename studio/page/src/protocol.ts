/** What the engine and the page say to each other. */

export type Call = { call: string } & Record<string, unknown>;
export type ToWorker = { id: number; request: Call } | { module: WebAssembly.Module };
export type FromWorker =
  | { id: number; ok: unknown }
  | { id: number; error: string }
  | { id: number; ended: string };

export interface World {
  name: string;
  walls: number[][];
  low: number[][];
  rooms: { name: string; outline: number[][] }[];
  lines: number[][];
  start: [number, number, number];
  bounds: [number, number, number, number];
  radius_m: number;
  sonar_rim_m: number;
}

/** Time, x, y, heading, battery, touches, width of each sonar's echo in microseconds. */
export type Shown = [number, number, number, number, number, number, (number | null)[]];

export interface Part {
  robot_us: number;
  shown: Shown[];
  active: [number, string[]][];
  words: [number, string][];
  log: [number, string][];
  people: [number, [number, number, number][]][];
  carried: number[];
  goes_on: boolean;
  end?: {
    trace: string;
    fault: string | null;
    finished_us: number | null;
    missions: { name: string; start_us: number; end_us: number }[];
    distance_m: number;
    collisions: number;
    rooms: string[];
    transitions: number;
    macro_steps: number;
  };
}

export interface Choice {
  from: string;
  to: string;
  event: string;
  heard: boolean;
  guard: string | null;
  terms: [string, boolean][];
  holds: boolean;
  taken: boolean;
}

export interface Choices {
  step: number;
  t_us: number;
  micro_steps: { event: string; choices: Choice[] }[];
}

export interface Drawn {
  svg: string | null;
  files?: string[];
  reason?: string;
}

export interface Diagnostic {
  range: { start: { line: number; character: number }; end: { line: number; character: number } };
  severity: number;
  code?: string;
  message: string;
}
