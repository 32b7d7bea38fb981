/** What the engine and the page say to each other. */

export type Call = { call: string } & Record<string, unknown>;
export type ToWorker = { id: number; request: Call; bytes?: Uint8Array } | { module: WebAssembly.Module };
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
export type Shown = [number, number, number, number, number | null, number | null, (number | null)[]];

export type Transition = [number, string, string, string, string[]];

export interface Part {
  robot_us: number;
  shown: Shown[];
  active: [number, string[]][];
  words: [number, string][];
  log: [number, string][];
  people: [number, [number, number, number][]][];
  walls: [number, [number, number, number, number]][];
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
    transitions: Transition[];
    period_us: number | null;
    macro_steps: number;
  };
}

export interface Recorded {
  board: string;
  firmware: string;
  hash: string | null;
  period_us: number | null;
  missions: { name: string; start_us: number; end_us: number }[];
  start_us: number;
  end_us: number;
  /** How many of the states, transitions and places that the page knows stay; behind them come these. */
  kept: [number, number, number];
  active: [number, string[]][];
  transitions: Transition[];
  faults: [number, string][];
  shown: Shown[];
  /** Of a robot that is connected: when the mission started that runs. */
  mission_start_us?: number | null;
}

export interface Since {
  step: number;
  t_us: number;
  first: boolean;
}

export interface Missing {
  event: string;
  guard: string | null;
  current: boolean;
  since: Since;
  terms: { name: string; set: boolean; since: Since }[];
  missing: number[][];
}

export interface Slots {
  start_us: number;
  slots: {
    number: number; start_us: number; period_us: number; duration_us: number; interpreter: boolean; tasks: string[];
  }[];
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
