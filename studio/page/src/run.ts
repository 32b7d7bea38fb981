/** A run: what is planned, what the engine has told of it, and the moment that is looked at. */
import { Engine, Refused } from "./engine";
import type { Choices, Part, Shown, World } from "./protocol";

export interface Plan {
  path: string;
  /** The page's files when it was planned. */
  files: Record<string, string>;
  world: string;
  seed: number;
  until_us: number;
  breaks: { sonar: number; fault: string; at_us: number }[];
  stop_at_us: number | null;
  /** Changed missions that take over, each with its files under a folder of its own. */
  then: { at_us: number; path: string; warm: boolean }[];
}

/** Robot time that is worked out before the page draws again, in microseconds. */
const SLICE_US = 2_000_000;

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

export class Run {
  world: World | null = null;
  shown: Shown[] = [];
  active: [number, string[]][] = [];
  words: [number, string][] = [];
  log: [number, string][] = [];
  people: [number, [number, number, number][]][] = [];
  carried: number[] = [];
  done_us = 0;
  end: Part["end"] | null = null;
  error: string | null = null;
  private engine: Engine;
  private isClosed = false;

  constructor(readonly plan: Plan, private told: () => void) {
    this.engine = new Engine((words) => {
      if (!this.isClosed && !this.error) this.fail(words);
    });
    void this.work();
  }

  private fail(words: string): void {
    this.error = words;
    this.told();
  }

  private async work(): Promise<void> {
    const { files, ...plan } = this.plan;
    try {
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
        this.carried = part.carried;
        this.done_us = part.goes_on ? part.robot_us : Math.min(part.robot_us, this.plan.until_us);
        goesOn = part.goes_on;
        if (part.end) this.end = part.end;
        this.told();
      }
    } catch (error) {
      if (this.isClosed) return;
      if (!(error instanceof Refused)) throw error;
      if (!this.error) this.fail(error.message);
    }
  }

  close(): void {
    this.isClosed = true;
    this.engine.close();
  }

  /** Where the robot is at a time, between what was told before and behind it. */
  at(t_us: number): Shown | null {
    const next = behind(this.shown, t_us, (it) => it[0]);
    const before = this.shown[Math.max(0, next - 1)];
    const after = this.shown[next];
    if (!before) return null;
    if (!after || after[0] === before[0] || t_us <= before[0]) return before;
    const part = (t_us - before[0]) / (after[0] - before[0]);
    const turn = Math.atan2(Math.sin(after[3] - before[3]), Math.cos(after[3] - before[3]));
    return [
      t_us, before[1] + (after[1] - before[1]) * part, before[2] + (after[2] - before[2]) * part,
      before[3] + turn * part, before[4], before[5], before[6],
    ];
  }

  activeAt(t_us: number): string[] {
    const index = behind(this.active, t_us, (it) => it[0]) - 1;
    return index < 0 ? [] : this.active[index][1];
  }

  peopleAt(t_us: number): [number, number, number][] {
    const index = behind(this.people, t_us, (it) => it[0]) - 1;
    return index < 0 ? [] : this.people[index][1];
  }

  /** What the machine had to choose from; none before the run is over. */
  async choices(t_us: number): Promise<Choices | null> {
    if (!this.end || this.error) return null;
    try {
      return await this.engine.call<Choices | null>({ call: "choices", t_us: Math.round(t_us) });
    } catch (error) {
      if (error instanceof Refused) return null;
      throw error;
    }
  }
}
