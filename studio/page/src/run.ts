/** A run: what the engine has told of it, and what can be asked about each of its moments. */
import { Engine, Refused } from "./engine";
import type { Choices, Missing, Part, Recorded, Shown, Slots, World } from "./protocol";

export interface Plan {
  path: string;
  /** The page's files when it was planned. */
  files: Record<string, string>;
  world: string;
  seed: number;
  until_us: number;
  breaks: { sonar: number; fault: string; at_us: number }[];
  stuck: { wheel: string; at_us: number }[];
  stop_at_us: number | null;
  /** Changed missions that take over, each with its files under a folder of its own. */
  then: { at_us: number; path: string; warm: boolean }[];
}

/** A term of the guard of a transition; `number` counts those from one state to the other. */
export interface TermOf {
  from: string;
  to: string;
  number: number;
  term: string;
}

/** Robot time that is worked out before the page draws again, in microseconds. */
const SLICE_US = 2_000_000;

/** How long the page waits before it asks for a robot's words again, after a request went wrong. */
const RETRY_MS = 500;

/** The first entry behind a time, in a list that is ordered by it. */
export function behind<T>(list: T[], t_us: number, time: (entry: T) => number): number {
  let [low, high] = [0, list.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (time(list[middle]) <= t_us) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** Puts entries behind the first so many of a list, in place of those that are there. */
function put<T>(list: T[], kept: number, entries: T[]): void {
  list.length = kept;
  for (const entry of entries) list.push(entry);
}

/** Turns a pose of odometry, which begins at the origin, to where the robot of a world starts. */
function placed(shown: Shown, [x, y, heading]: [number, number, number]): Shown {
  const [sin, cos] = [Math.sin(heading), Math.cos(heading)];
  return [
    shown[0], x + shown[1] * cos - shown[2] * sin, y + shown[1] * sin + shown[2] * cos, shown[3] + heading,
    shown[4], shown[5], shown[6],
  ];
}

/** How a robot that is connected is, as the command says. */
export interface Connected {
  board: string;
  error: string | null;
  /** How old its mission was when this was told, as well as the command knows. */
  mission_us: number | null;
  notes: string[];
  slots: { number: number; executed: number; missed: number; overruns: number; load: number; delay_us: number }[];
}

/** What is looked at: a simulated run, a recording, or a robot that is connected. */
export class Run {
  world: World | null = null;
  shown: Shown[] = [];
  active: [number, string[]][] = [];
  /** Time, source, target, event, events that were sent. */
  transitions: [number, string, string, string, string[]][] = [];
  faults: [number, string][] = [];
  words: [number, string][] = [];
  log: [number, string][] = [];
  people: [number, [number, number, number][]][] = [];
  walls: [number, [number, number, number, number]][] = [];
  carried: number[] = [];
  missions: { name: string; start_us: number; end_us: number }[] = [];
  /** Where its time begins and where it ends, as far as that is known. */
  start_us = 0;
  done_us = 0;
  period_us = 10_000;
  end: Part["end"] | null = null;
  error: string | null = null;
  /** What a recording lacks. */
  note: string | null = null;
  /** Whether each moment can be asked about. */
  isWhole = false;
  connected: Connected | null = null;
  /** How long after it happened on the robot the page knew of the last transition, in milliseconds. */
  behind_ms: number | null = null;
  private engine: Engine;
  /** What is asked about a robot that is connected: another instance, so that no news waits for an answer. */
  private asked: Engine;
  private isClosed = false;
  /** Curves and terms that are of what was told last; what is shown is what was known before. */
  private fresh = new Set<string>();
  private curve_cache = new Map<string, [number, number][]>();
  private term_cache = new Map<string, [number, boolean][]>();

  private constructor(readonly kind: "simulated" | "recorded" | "live", readonly plan: Plan | null, private told: () => void) {
    const engine = () => new Engine((words) => {
      if (!this.isClosed && !this.error) this.fail(words);
    });
    this.engine = engine();
    this.asked = kind === "live" ? engine() : this.engine;
  }

  /** A run in a simulated world. */
  static simulated(plan: Plan, told: () => void): Run {
    const run = new Run("simulated", plan, told);
    void run.guarded(() => run.simulate(plan));
    return run;
  }

  /** A recording of a robot, or of a run. */
  static recorded(bytes: Uint8Array, told: () => void): Run {
    const run = new Run("recorded", null, told);
    void run.guarded(async () => {
      const recorded = await run.engine.call<Recorded & { ended: string | null; whole: boolean }>({ call: "record" }, bytes);
      run.take(recorded);
      run.note = recorded.ended;
      run.isWhole = true;
      run.told();
    });
    return run;
  }

  /** The robot that the command is connected to. */
  static live(told: () => void): Run {
    const run = new Run("live", null, told);
    void run.guarded(() => run.listen());
    return run;
  }

  /** The end of the axis of time, in microseconds. */
  get until_us(): number {
    return Math.max(this.start_us + 1, this.plan?.until_us ?? this.done_us);
  }

  private fail(words: string): void {
    this.error = words;
    this.told();
  }

  private async guarded(work: () => Promise<void>): Promise<void> {
    try {
      await work();
    } catch (error) {
      if (this.isClosed) return;
      if (!(error instanceof Refused)) throw error;
      if (!this.error) this.fail(error.message);
    }
  }

  private async simulate({ files, ...plan }: Plan): Promise<void> {
    await this.engine.call({ call: "files", files });
    this.world = await this.engine.call<World>({ call: "start", ...plan });
    this.told();
    let goesOn = true;
    while (goesOn && !this.isClosed) {
      const part = await this.engine.call<Part>({ call: "go_on", to_us: this.done_us + SLICE_US });
      this.shown.push(...part.shown);
      this.active.push(...part.active);
      this.words.push(...part.words);
      this.log.push(...part.log);
      this.people.push(...part.people);
      this.walls.push(...part.walls);
      this.carried = part.carried;
      this.done_us = part.goes_on ? part.robot_us : Math.min(part.robot_us, plan.until_us);
      goesOn = part.goes_on;
      if (part.end) {
        this.end = part.end;
        this.missions = part.end.missions;
        this.transitions = part.end.transitions;
        this.period_us = part.end.period_us ?? this.period_us;
        this.isWhole = true;
      }
      this.told();
    }
  }

  private take(recorded: Recorded): void {
    const [active, transitions, shown] = recorded.kept;
    put(this.active, active, recorded.active);
    put(this.transitions, transitions, recorded.transitions);
    put(this.shown, shown, recorded.shown);
    this.faults = recorded.faults;
    this.missions = recorded.missions;
    this.start_us = recorded.start_us;
    this.done_us = recorded.end_us;
    this.period_us = recorded.period_us ?? this.period_us;
  }

  /** Asks the command for what the robot says, until the page lets go of it. */
  private async listen(): Promise<void> {
    let from = 0;
    let seen = "";
    let lines = 0;
    let mission_start_us: number | null = null;
    while (!this.isClosed) {
      try {
        // An answer may have waited for news: what counts is when it comes.
        const answer = await fetch(`live?from=${from}&seen=${seen}&log=${lines}`, { cache: "no-store" });
        if (!answer.ok) throw new Error(String(answer.status));
        const body = await answer.arrayBuffer();
        const heard_ms = performance.now();
        const head_bytes = new DataView(body).getUint32(0, true);
        const head = JSON.parse(new TextDecoder().decode(new Uint8Array(body, 4, head_bytes))) as Connected & {
          from: number; steps: number | null; seen: string; log: [number | null, string][]; log_lines: number;
        };
        const bytes = new Uint8Array(body, 4 + head_bytes);
        if (head.from !== from) throw new Error("another place");
        from += bytes.length;
        seen = head.seen;
        lines = head.log_lines;
        this.connected = head;
        const told = this.engine.call<Recorded | null>({ call: "news", steps: head.steps }, bytes);
        // Who is asked tells of its end by itself.
        this.asked.call({ call: "hear", steps: head.steps }, bytes).catch(() => {});
        const recorded = await told;
        if (recorded) {
          const before = this.transitions.at(-1)?.[0];
          this.take(recorded);
          const last = this.transitions.at(-1)?.[0];
          const start_us = recorded.mission_start_us ?? null;
          mission_start_us = start_us;
          if (last !== undefined && last !== before && head.mission_us !== null && start_us !== null) {
            const now_us = start_us + head.mission_us + (performance.now() - heard_ms) * 1000;
            this.behind_ms = Math.max(0, (now_us - last) / 1000);
          }
          this.fresh.clear();
          this.isWhole = true;
        }
        for (const [mission_us, text] of head.log) {
          const isTimed = mission_us !== null && mission_start_us !== null;
          this.log.push([isTimed ? mission_start_us! + mission_us : this.done_us, text]);
        }
        this.error = head.error;
        this.told();
        if (head.error) return;
      } catch (error) {
        if (error instanceof Refused) throw error;
        if (this.isClosed) return;
        this.connected = null;
        this.told();
        await new Promise((done) => setTimeout(done, RETRY_MS));
      }
    }
  }

  close(): void {
    this.isClosed = true;
    this.engine.close();
    this.asked.close();
  }

  /** The robot at a moment, of the odometry of a recording as it stands in a world. */
  private entry(index: number, world: World | null): Shown | undefined {
    const shown = this.shown[index];
    return shown && this.kind !== "simulated" && world ? placed(shown, world.start) : shown;
  }

  /** Where the robot is at a time, between what was told before and behind it. */
  at(t_us: number, world: World | null): Shown | null {
    const next = behind(this.shown, t_us, (it) => it[0]);
    const before = this.entry(Math.max(0, next - 1), world);
    const after = this.entry(next, world);
    if (!before) return null;
    if (!after || after[0] === before[0] || t_us <= before[0]) return before;
    const part = (t_us - before[0]) / (after[0] - before[0]);
    const turn = Math.atan2(Math.sin(after[3] - before[3]), Math.cos(after[3] - before[3]));
    return [
      t_us, before[1] + (after[1] - before[1]) * part, before[2] + (after[2] - before[2]) * part,
      before[3] + turn * part, before[4], before[5], before[6],
    ];
  }

  /** The way of the robot: places, and how many of them are behind it at a time. */
  way(t_us: number, world: World | null): [number[][], number] {
    const way = this.shown.map((_, index) => {
      const shown = this.entry(index, world)!;
      return [shown[1], shown[2]];
    });
    return [way, behind(this.shown, t_us, (it) => it[0])];
  }

  activeAt(t_us: number): string[] {
    const index = behind(this.active, t_us, (it) => it[0]) - 1;
    return index < 0 ? [] : this.active[index][1];
  }

  peopleAt(t_us: number): [number, number, number][] {
    const index = behind(this.people, t_us, (it) => it[0]) - 1;
    return index < 0 ? [] : this.people[index][1];
  }

  wallsAt(t_us: number): [number, number, number, number][] {
    return this.walls.filter(([from]) => from <= t_us).map(([, wall]) => wall);
  }

  private async ask<T>(request: { call: string } & Record<string, unknown>): Promise<T | null> {
    if (!this.isWhole || this.isClosed) return null;
    try {
      return await this.asked.call<T>(request);
    } catch (error) {
      if (error instanceof Refused) return null;
      throw error;
    }
  }

  /** What the machine had to choose from. */
  choices(t_us: number): Promise<Choices | null> {
    return this.ask({ call: "choices", t_us: Math.round(t_us) });
  }

  /** Why the transitions from one state to another were not taken. */
  async missing(t_us: number, from: string, to: string): Promise<Missing[]> {
    return (await this.ask<Missing[]>({ call: "missing", t_us: Math.round(t_us), from, to })) ?? [];
  }

  slots(t_us: number): Promise<Slots | null> {
    return this.ask({ call: "slots", t_us: Math.round(t_us) });
  }

  /** Which numbers there are to plot, with their units. */
  async curves(): Promise<[string, string][]> {
    return (await this.ask<[string, string][]>({ call: "curves" })) ?? [];
  }

  /** What is known of a number without asking. */
  knownCurve(name: string): [number, number][] | undefined {
    return this.curve_cache.get(name);
  }

  async curve(name: string): Promise<[number, number][]> {
    const known = this.curve_cache.get(name);
    if (known && this.fresh.has(name)) return known;
    this.fresh.add(name);
    const points = await this.ask<[number, number][]>({ call: "curve", name });
    if (points) this.curve_cache.set(name, points);
    return points ?? known ?? [];
  }

  knownTerm(term: TermOf): [number, boolean][] | undefined {
    return this.term_cache.get(JSON.stringify(term));
  }

  async term(term: TermOf): Promise<[number, boolean][]> {
    const key = JSON.stringify(term);
    const known = this.term_cache.get(key);
    if (known && this.fresh.has(key)) return known;
    this.fresh.add(key);
    const changes = await this.ask<[number, boolean][]>({ call: "term", ...term });
    if (changes) this.term_cache.set(key, changes);
    return changes ?? known ?? [];
  }
}
