/** What the page knows, and what can be done in it. */
import { Editor, type Problem } from "./editor";
import { Engine, Refused } from "./engine";
import type { Choices, Drawn, Missing, Shown, Slots, World } from "./protocol";
import { behind, type Plan, Run, type TermOf } from "./run";
import { type Interventions, type Moment, opened, pack, unpack } from "./share";
import { languages, wanted } from "./words";

interface Catalogue {
  /** Missions and worlds by their paths below the root. */
  files: Record<string, string>;
  /** The file to open at first. */
  open?: string;
  /** Whether the command is connected to a robot. */
  live?: boolean;
}

/** What pauses the run. */
export type Breakpoint =
  | { kind: "state"; path: string }
  | { kind: "transition"; from: string; to: string }
  | ({ kind: "term" } & TermOf)
  | { kind: "value"; curve: string; above: boolean; limit: number };

const untouched = (): Interventions => ({ breaks: [], stuck: [], stop_at_us: null, lines: [] });
/** The first bytes of a recording. */
const RECORDING_MARK = "ESMREC";

const KEPT = "esm.files";
const FIRST = "/missions/patrol.esm";
const FIRST_WORLD = "/missions/worlds/office.world";
const DEFAULT_UNTIL_US = 60_000_000;
const LONGEST_US = 3_600_000_000;
const DARK = matchMedia("(prefers-color-scheme: dark)");
export const SPEEDS = [0.25, 1, 4, 16];

/**
 * A mission with all that it uses, and a world, from the checkout that the page lies in: a web server that serves the
 * checkout has no catalogue, and links of the book lead there.
 */
async function ofCheckout({ path, world }: { path: string; world: string }): Promise<Catalogue> {
  const files: Record<string, string> = {};
  const wanted = [path, world];
  for (const place of wanted) {
    if (place in files) continue;
    const answer = await fetch(`../..${place}`);
    if (!answer.ok) throw new Error(`${place}: ${answer.status}`);
    files[place] = await answer.text();
    for (const [, used] of files[place].matchAll(/^\s*use\s+"([^"]+)"/gm)) {
      wanted.push(new URL(used, `http://checkout${place}`).pathname);
    }
  }
  return { files };
}

export class Studio {
  language = wanted();
  /** Files as they ship or were given, and those that were changed or made here. */
  shipped: Record<string, string> = {};
  given: string[] = [];
  own: Record<string, string> = {};
  path = FIRST;
  worldPath = FIRST_WORLD;
  world: World | null = null;
  problems: Problem[] = [];
  drawn: Drawn | null = null;
  /** Whether the diagram is of an older text. */
  isStale = false;
  showsData = false;
  /** How many levels of superstates show their inside; all, for none. */
  depth: number | null = null;
  /** Superstates that show theirs otherwise than their level says. */
  private folds = new Set<string>();
  cursor = 0;
  run: Run | null = null;
  until_us = DEFAULT_UNTIL_US;
  t_us = 0;
  isPlaying = false;
  speed = 1;
  breakpoints = new Map<string, Breakpoint>();
  choices: Choices | null = null;
  /** The transition that is asked about, and why it was not taken. */
  asked: { from: string; to: string } | null = null;
  missing: Missing[] = [];
  slots: Slots | null = null;
  /** Numbers that can be plotted, with their units, and those that are. */
  curves: [string, string][] = [];
  plotted: string[] = [];
  /** What is shown below the states. */
  showsSlots = false;
  showsEvents = false;
  /** Whether the moment goes along with a robot that is connected. */
  follows = true;
  isLive = false;
  notice = "";
  message = "";
  tour = -1;
  isLoaded = false;
  /** What the next click in the world puts there. */
  places: "person" | "wall" | null = null;
  /** The part that a narrow screen shows. */
  tab: "text" | "diagram" | "robot" | "why" = "text";
  theme = localStorage.getItem("esm.theme") ?? "";
  editor!: Editor;
  private desk: Engine;
  private interventions = untouched();
  private then: { at_us: number; path: string; warm: boolean; text: string }[] = [];
  private planText = "";
  private listeners = new Set<() => void>();
  private lastFrame = 0;
  /** Where the robot was at the moment that was looked at last. */
  private seen: [number, Shown] | null = null;
  /** Where to go as soon as the run has come there. */
  private goesTo_us: number | null = null;
  private isDrawing = false;
  /** The recording whose mission is open, and how often a robot has told something. */
  private recorded: Run | null = null;
  private live_told = 0;
  private drawsAgain = false;
  private isAsking = false;
  private asked_us = -1;
  private frame = 0;

  constructor() {
    this.desk = new Engine((words) => this.ended(words));
    this.applyTheme();
    DARK.addEventListener("change", () => {
      this.applyTheme();
      this.tell();
    });
  }

  get words() {
    return languages[this.language];
  }

  listen(listener: () => void): () => void {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  tell = (): void => {
    for (const listener of this.listeners) listener();
  };

  set(change: Partial<Studio>): void {
    Object.assign(this, change);
    this.tell();
  }

  // Files.

  text(path: string): string {
    return this.own[path] ?? this.shipped[path] ?? "";
  }

  files(): Record<string, string> {
    const all = { ...this.shipped, ...this.own };
    return Object.fromEntries(Object.entries(all).filter(([path]) => path.endsWith(".esm")));
  }

  worldText(): string {
    return [this.text(this.worldPath), ...this.interventions.lines].join("\n");
  }

  async begin(place: HTMLElement): Promise<void> {
    try {
      this.own = JSON.parse(localStorage.getItem(KEPT) ?? "{}");
    } catch {
      this.own = {};
    }
    const named = opened(location.hash);
    const answer = await fetch("files.json");
    const catalogue = answer.ok
      ? (await answer.json()) as Catalogue
      : await ofCheckout(named ?? { path: FIRST, world: FIRST_WORLD });
    this.shipped = catalogue.files;
    this.given = Object.keys(catalogue.files).filter((path) => !path.startsWith("/missions/"));
    if (catalogue.open) this.path = catalogue.open;
    this.isLive = catalogue.live === true;
    const shared = await unpack(location.hash);
    if (shared) {
      this.path = shared.path;
      if (shared.text !== this.shipped[shared.path]) this.own[shared.path] = shared.text;
      if (this.shipped[shared.world] || this.own[shared.world]) this.worldPath = shared.world;
    } else if (named) {
      if (named.path in this.shipped) this.path = named.path;
      if (named.world in this.shipped) this.worldPath = named.world;
    } else if (!catalogue.open) {
      const last = localStorage.getItem("esm.path");
      if (last && this.text(last)) this.path = last;
      const world = localStorage.getItem("esm.world");
      if (world && this.text(world)) this.worldPath = world;
    }
    this.editor = new Editor(this.desk, {
      changed: (text) => this.changed(text),
      moved: (offset) => this.set({ cursor: offset }),
      problems: (problems) => this.set({ problems }),
      show: (path) => this.openFile(path),
    }, this.words.editorLabel);
    place.append(this.editor.view.dom);
    this.isLoaded = true;
    await this.giveFiles();
    await this.openFile(this.path);
    await this.showWorld();
    addEventListener("hashchange", () => void this.followLink());
    if (shared?.moment) this.resume(shared.moment);
    else if (this.isLive) this.connect();
    else if (named) this.start();
    else if (!localStorage.getItem("esm.toured")) this.set({ tour: 0 });
  }

  /** Opens what a link names that is followed in the open page. */
  private async followLink(): Promise<void> {
    const named = opened(location.hash);
    if (!named || !(named.path in this.shipped)) return;
    if (named.world in this.shipped) this.worldPath = named.world;
    await this.openFile(named.path);
    await this.showWorld();
    this.start();
  }

  /** Has a run again as a bookmark holds it, and goes to its moment. */
  private resume(moment: Moment): void {
    this.until_us = Math.min(LONGEST_US, moment.until_us);
    this.interventions = { ...untouched(), ...moment.interventions };
    this.then = moment.then;
    this.planText = moment.text ?? this.text(this.path);
    this.plan(false);
    this.goesTo_us = moment.t_us;
  }

  private async giveFiles(): Promise<void> {
    await this.desk.call({ call: "files", files: this.files() });
  }

  async openFile(path: string): Promise<void> {
    this.forget();
    await this.openText(path);
  }

  /** Shows a file, and lets the run be. */
  private async openText(path: string): Promise<void> {
    if (path !== this.path) this.folds.clear();
    this.path = path;
    localStorage.setItem("esm.path", path);
    this.drawn = null;
    this.problems = [];
    this.editor.open(path, this.text(path), this.words.editorLabel);
    this.tell();
    await this.draw();
  }

  private changed(text: string): void {
    if (text === this.shipped[this.path]) delete this.own[this.path];
    else this.own[this.path] = text;
    this.keepFiles();
    void this.draw();
    this.tell();
  }

  /** Keeps what was written in the browser. */
  private keepFiles(): void {
    try {
      localStorage.setItem(KEPT, JSON.stringify(this.own));
    } catch {
      this.message = this.words.notKept;
    }
  }

  /** Back to the file as it ships. */
  restore(): void {
    delete this.own[this.path];
    this.keepFiles();
    void this.openFile(this.path);
  }

  async openFromDisk(): Promise<void> {
    const input = document.createElement("input");
    input.type = "file";
    input.accept = ".esm,.world,.rec";
    input.multiple = true;
    input.onchange = () => void this.takeFiles([...(input.files ?? [])]);
    input.click();
  }

  /** Takes files from the disk: missions, worlds, or a recording. */
  async takeFiles(files: File[]): Promise<void> {
    let last = "";
    let recording: Uint8Array | null = null;
    for (const file of files) {
      const mark = await file.slice(0, RECORDING_MARK.length).text();
      if (mark === RECORDING_MARK) {
        recording = new Uint8Array(await file.arrayBuffer());
        continue;
      }
      const path = "/yours/" + file.name;
      this.own[path] = await file.text();
      if (path.endsWith(".world")) this.worldPath = path;
      else last = path;
    }
    this.keepFiles();
    await this.giveFiles();
    if (last) await this.openFile(last);
    await this.showWorld();
    if (recording) this.look(Run.recorded(recording, () => this.recordingTold()));
  }

  /** Shows what the connected robot does. */
  connect(): void {
    this.follows = true;
    this.look(Run.live(() => this.recordingTold()));
  }

  /** Looks at a recording, or at a robot. */
  private look(run: Run): void {
    this.forget();
    this.run = run;
    this.tell();
  }

  private async recordingTold(): Promise<void> {
    const run = this.run;
    if (!run) return;
    const isFirst = this.recorded !== run && run.missions.length > 0;
    if (isFirst) {
      this.recorded = run;
      this.t_us = run.start_us;
      await this.showMission(run);
      if (run.kind === "recorded") void this.prepare();
    }
    if (run.kind === "live") {
      if (this.follows && !this.isPlaying) this.t_us = Math.max(run.start_us, run.done_us - run.period_us);
      this.live_told += 1;
      // Numbers come a few times a second: often enough for eyes.
      if (this.live_told % 8 === 1) void this.prepare();
    }
    void this.ask();
    this.tell();
  }

  /** Opens the text of the mission that runs, if it is here. */
  private async showMission(run: Run): Promise<void> {
    const name = run.missions[run.missions.length - 1].name;
    const is = (path: string) => path.split("/").pop() === `${name}.esm`
      || new RegExp(`^\\s*machine\\s+${name}\\b`, "m").test(this.text(path));
    const all = [this.path, ...Object.keys(this.own), ...Object.keys(this.shipped)];
    const path = all.find((path) => path.endsWith(".esm") && is(path));
    if (!path) {
      this.message = this.words.noText(name);
      return;
    }
    if (path === this.path) return;
    await this.openText(path);
  }

  saveToDisk(): void {
    const link = document.createElement("a");
    const address = URL.createObjectURL(new Blob([this.text(this.path)], { type: "text/plain" }));
    link.href = address;
    link.download = this.path.split("/").pop() ?? "mission.esm";
    link.click();
    URL.revokeObjectURL(address);
  }

  async share(): Promise<void> {
    const { interventions, then, until_us, t_us, planText } = this;
    const isSimulated = this.run?.kind === "simulated";
    const moment = isSimulated ? { t_us, until_us, interventions, then, text: planText } : undefined;
    const hash = await pack({ path: this.path, text: this.text(this.path), world: this.worldPath, moment });
    history.replaceState(null, "", hash);
    try {
      await navigator.clipboard.writeText(location.href);
      this.set({ message: this.words.shared });
    } catch {
      this.set({ message: this.words.notShared });
    }
  }

  // The diagram.

  /** Shows so many levels of superstates, and none of them otherwise. */
  showDepth(depth: number | null): void {
    this.depth = depth;
    this.folds.clear();
    void this.draw();
  }

  /** Folds or opens one superstate. */
  fold(path: string): Promise<void> {
    if (!this.folds.delete(path)) this.folds.add(path);
    return this.draw();
  }

  async draw(): Promise<void> {
    if (this.isDrawing) {
      this.drawsAgain = true;
      return;
    }
    this.isDrawing = true;
    do {
      this.drawsAgain = false;
      const path = this.path;
      try {
        await this.giveFiles();
        const drawn = await this.desk.call<Drawn>({ call: "draw", path, depth: this.depth, otherwise: [...this.folds], data: this.showsData });
        if (path === this.path) {
          this.isStale = drawn.svg === null;
          if (drawn.svg !== null || this.drawn === null) this.drawn = drawn;
          this.tell();
        }
      } catch (error) {
        if (!(error instanceof Refused)) throw error;
      }
    } while (this.drawsAgain);
    this.isDrawing = false;
  }

  private ended(words: string): void {
    this.message = `${this.words.restarted} ${words}`;
    this.isDrawing = false;
    void this.giveFiles().then(() => {
      this.editor?.again();
      return this.draw();
    }, () => this.tell());
    this.tell();
  }

  // The run.

  async openWorld(path: string): Promise<void> {
    this.worldPath = path;
    localStorage.setItem("esm.world", path);
    const hadRun = this.run !== null;
    this.forget();
    await this.showWorld();
    if (hadRun) this.start();
  }

  private async showWorld(): Promise<void> {
    try {
      this.world = await this.desk.call<World>({ call: "world", text: this.worldText() });
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      this.message = error.message;
    }
    this.tell();
  }

  /** Whether the text is another one than that of the run. */
  get isOutdated(): boolean {
    const last = this.then.at(-1)?.text ?? this.planText;
    return this.run?.kind === "simulated" && last !== this.text(this.path);
  }

  /** Lets go of the run. */
  private forget(): void {
    this.run?.close();
    this.run = null;
    this.t_us = 0;
    this.isPlaying = false;
    this.choices = null;
    this.asked = null;
    this.missing = [];
    this.slots = null;
    this.curves = [];
    this.then = [];
    this.notice = "";
    this.goesTo_us = null;
    this.seen = null;
    this.recorded = null;
    this.live_told = 0;
    this.interventions = untouched();
  }

  /** Begins a run of the text as it is. */
  start(): void {
    if (this.run && this.run.kind !== "simulated") this.forget();
    this.then = [];
    this.planText = this.text(this.path);
    this.t_us = 0;
    this.seen = null;
    this.notice = "";
    this.plan(true);
  }

  /** Works the run out with all that is done to it, and stays where it is. */
  private plan(plays: boolean): void {
    this.run?.close();
    const files: Record<string, string> = { ...this.files(), [this.path]: this.planText };
    const then = this.then.map((change, index) => {
      // Each text has a folder of its own, with the files around it.
      const folder = `/change${index + 1}`;
      for (const [path, text] of Object.entries(this.files())) files[folder + path] = text;
      files[folder + this.path] = change.text;
      return { at_us: change.at_us, path: folder + this.path, warm: change.warm };
    });
    const { breaks, stuck, stop_at_us } = this.interventions;
    this.run = Run.simulated({
      path: this.path, files, world: this.worldText(), seed: 1, until_us: this.until_us, breaks, stuck, stop_at_us, then,
    }, () => this.runTold());
    this.choices = null;
    this.missing = [];
    this.slots = null;
    this.asked_us = -1;
    this.isPlaying = plays;
    if (plays) this.animate();
    this.tell();
  }

  private runTold(): void {
    const run = this.run;
    if (run?.world) this.world = run.world;
    if (run && this.goesTo_us !== null && run.done_us >= this.goesTo_us) {
      this.t_us = this.goesTo_us;
      this.goesTo_us = null;
    }
    if (run?.end) void this.prepare();
    if (run?.end && this.then.length > 0 && run.carried.length > this.then.length) {
      const last = this.then[this.then.length - 1];
      this.notice = this.words.changed(run.carried[run.carried.length - 1], seconds(last.at_us));
    }
    void this.ask();
    this.tell();
  }

  /** Fetches what breakpoints and plots need of a run. */
  private async prepare(): Promise<void> {
    const run = this.run;
    if (!run) return;
    const curves = await run.curves();
    if (run !== this.run) return;
    this.curves = curves;
    if (this.showsSlots) this.slots = await run.slots(this.t_us);
    const names = new Set(this.plotted);
    for (const it of this.breakpoints.values()) if (it.kind === "value") names.add(it.curve);
    const wanted = [...names].filter((name) => curves.some(([known]) => known === name));
    const terms = [...this.breakpoints.values()].filter((it) => it.kind === "term");
    await Promise.all([...wanted.map((name) => run.curve(name)), ...terms.map((term) => run.term(termOf(term)))]);
    if (run === this.run) this.tell();
  }

  /** Plots a number over time, or no longer. */
  plot(name: string): void {
    this.plotted = this.plotted.includes(name) ? this.plotted.filter((it) => it !== name) : [...this.plotted, name];
    void this.prepare();
    this.tell();
  }

  showSlots(): void {
    this.showsSlots = !this.showsSlots;
    void this.prepare();
    this.tell();
  }

  /** Asks why a transition was not taken, or no longer. */
  why(from: string, to: string): void {
    const isSame = this.asked?.from === from && this.asked.to === to;
    this.asked = isSame ? null : { from, to };
    this.missing = [];
    this.asked_us = -1;
    void this.ask();
    this.tell();
  }

  /** Lets the changed text take over at this moment. */
  change(): void {
    if (!this.run) return;
    this.then = this.then.filter((change) => change.at_us < this.t_us);
    this.then.push({ at_us: Math.round(this.t_us), path: this.path, warm: true, text: this.text(this.path) });
    this.plan(this.isPlaying);
  }

  longer(): void {
    this.until_us = Math.min(LONGEST_US, this.until_us * 2);
    if (this.run) this.plan(this.isPlaying);
    else this.tell();
  }

  killSonar(sonar: number): void {
    this.interventions.breaks = this.interventions.breaks.filter((it) => it.sonar !== sonar);
    this.interventions.breaks.push({ sonar, fault: "dead", at_us: Math.round(this.t_us) });
    this.plan(this.isPlaying);
  }

  pressStop(): void {
    this.interventions.stop_at_us = Math.round(this.t_us);
    this.plan(this.isPlaying);
  }

  stopWheel(wheel: string): void {
    this.interventions.stuck = this.interventions.stuck.filter((it) => it.wheel !== wheel);
    this.interventions.stuck.push({ wheel, at_us: Math.round(this.t_us) });
    this.plan(this.isPlaying);
  }

  /** Adds a line to the world: what it says is there from this moment on. */
  private putLine(line: string): void {
    this.interventions.lines.push(`${line} from ${Math.max(1, Math.round(this.t_us / 1000))} ms`);
    this.places = null;
    this.plan(this.isPlaying);
  }

  putPerson(x: number, y: number): void {
    this.putLine(`person ${x.toFixed(2)},${y.toFixed(2)} 0.25`);
  }

  putWall(ax: number, ay: number, bx: number, by: number): void {
    this.putLine(`wall ${ax.toFixed(2)},${ay.toFixed(2)} ${bx.toFixed(2)},${by.toFixed(2)}`);
  }

  /** Puts a wall of 0.8 m across the robot's way. */
  putWallAhead(): void {
    const at = this.robot();
    if (!at) return;
    const [x, y] = [at[1] + 0.8 * Math.cos(at[3]), at[2] + 0.8 * Math.sin(at[3])];
    const [across_x, across_y] = [-0.4 * Math.sin(at[3]), 0.4 * Math.cos(at[3])];
    this.putWall(x - across_x, y - across_y, x + across_x, y + across_y);
  }

  putPersonAhead(): void {
    const at = this.robot();
    if (at) this.putPerson(at[1] + 0.8 * Math.cos(at[3]), at[2] + 0.8 * Math.sin(at[3]));
  }

  clearInterventions(): void {
    this.interventions = untouched();
    this.plan(this.isPlaying);
  }

  interventionWords(): string[] {
    const { breaks, stuck, stop_at_us, lines } = this.interventions;
    return [
      ...breaks.map((it) => `${this.words.sonar(it.sonar)} · ${seconds(it.at_us)}`),
      ...stuck.map((it) => `${this.words.wheel(it.wheel)} · ${seconds(it.at_us)}`),
      ...(stop_at_us === null ? [] : [`${this.words.stop} · ${seconds(stop_at_us)}`]),
      ...lines.map((line) => line.replace(/ from (\d+) ms/, (_, ms) => ` · ${seconds(ms * 1000)}`)),
    ];
  }

  robot(): Shown | null {
    const { run, t_us } = this;
    if (!run) return null;
    // A run that is worked out anew is the same up to here: until it has come so far, what was known stays.
    if (run.done_us < t_us && this.seen?.[0] === t_us) return this.seen[1];
    const at = run.at(t_us, this.world);
    if (at && run.done_us >= t_us) this.seen = [t_us, at];
    return at;
  }

  // Time.

  get isOver(): boolean {
    return this.run !== null && this.run.isWhole && this.run.kind !== "live" && this.t_us >= this.run.done_us;
  }

  play(): void {
    if (!this.run) return this.start();
    if (this.isOver) this.t_us = this.run.start_us;
    if (this.run.kind === "live") {
      this.follows = true;
      return this.tell();
    }
    this.isPlaying = true;
    this.animate();
    this.tell();
  }

  pause(): void {
    this.isPlaying = false;
    this.follows = false;
    void this.ask();
    this.tell();
  }

  toggle(): void {
    const goesOn = this.run?.kind === "live" ? this.follows : this.isPlaying;
    if (goesOn) this.pause();
    else this.play();
  }

  seek(t_us: number): void {
    this.notice = "";
    this.follows = false;
    this.t_us = Math.max(this.run?.start_us ?? 0, Math.min(t_us, this.run?.done_us ?? 0));
    if (this.showsSlots) void this.prepare();
    void this.ask();
    this.tell();
  }

  /** One macro step. They have the distance of the interpreter's slot; the engine knows which is next. */
  step(by: 1 | -1): void {
    this.isPlaying = false;
    const period_us = this.run?.period_us ?? 10_000;
    const at = Math.floor(this.t_us / period_us) * period_us;
    this.seek(by > 0 ? at + period_us : this.t_us > at ? at : at - period_us);
  }

  private animate(): void {
    cancelAnimationFrame(this.frame);
    this.lastFrame = 0;
    this.frame = requestAnimationFrame((now) => this.tick(now));
  }

  private tick(now: number): void {
    const run = this.run;
    if (!this.isPlaying || !run) return;
    const passed_ms = this.lastFrame === 0 ? 0 : Math.min(100, now - this.lastFrame);
    this.lastFrame = now;
    const before = this.t_us;
    let to = Math.min(before + passed_ms * 1000 * this.speed, run.done_us);
    const reached = this.breakBetween(before, to);
    if (reached) {
      to = reached.t_us;
      this.isPlaying = false;
      this.notice = this.words.breakHere(breakWords(reached.breakpoint, this.words));
    }
    this.t_us = to;
    if ((run.isWhole || run.error) && to >= run.done_us) this.isPlaying = false;
    void this.ask();
    this.tell();
    if (this.isPlaying) this.frame = requestAnimationFrame((next) => this.tick(next));
  }

  /** The first breakpoint that is reached behind `from` and up to `to`. */
  private breakBetween(from: number, to: number): { t_us: number; breakpoint: Breakpoint } | null {
    let first: { t_us: number; breakpoint: Breakpoint } | null = null;
    for (const breakpoint of this.breakpoints.values()) {
      const t_us = this.reached(breakpoint, from, to);
      if (t_us !== null && (first === null || t_us < first.t_us)) first = { t_us, breakpoint };
    }
    return first;
  }

  /** When a breakpoint is reached for the first time behind `from` and up to `to`. */
  private reached(breakpoint: Breakpoint, from: number, to: number): number | null {
    const run = this.run;
    if (!run) return null;
    /** The first entry in that time that is meant, with the one before it. */
    function find<T extends readonly [number, ...unknown[]]>(list: T[], isMeant: (entry: T, before: T | undefined) => boolean) {
      for (let index = behind(list, from, (it) => it[0]); index < list.length && list[index][0] <= to; index++) {
        if (isMeant(list[index], list[index - 1])) return list[index][0];
      }
      return null;
    }
    if (breakpoint.kind === "state") {
      const { path } = breakpoint;
      return find(run.active, ([, now], before) => now.includes(path) && !before?.[1].includes(path));
    }
    if (breakpoint.kind === "transition") {
      return find(run.transitions, ([, from, to]) => from === breakpoint.from && to === breakpoint.to);
    }
    if (breakpoint.kind === "term") return find(run.knownTerm(termOf(breakpoint)) ?? [], ([, isSet]) => isSet);
    const { above, limit } = breakpoint;
    const isBeyond = (value: number | undefined) => value !== undefined && (above ? value > limit : value < limit);
    return find(run.knownCurve(breakpoint.curve) ?? [], ([, value], before) => isBeyond(value) && !isBeyond(before?.[1]));
  }

  /** Sets a breakpoint, or takes it back. */
  toggleBreakpoint(breakpoint: Breakpoint): void {
    const key = keyOf(breakpoint);
    if (!this.breakpoints.delete(key)) this.breakpoints.set(key, breakpoint);
    void this.prepare();
    this.tell();
  }

  hasBreakpoint(breakpoint: Breakpoint): boolean {
    return this.breakpoints.has(keyOf(breakpoint));
  }

  /** Asks for the choices of this moment, one question at a time. */
  private async ask(): Promise<void> {
    const run = this.run;
    if (!run?.isWhole || this.isAsking || this.asked_us === this.t_us) return;
    this.isAsking = true;
    this.asked_us = this.t_us;
    const asked = this.asked;
    const choices = await run.choices(this.asked_us);
    const missing = asked ? await run.missing(this.asked_us, asked.from, asked.to) : [];
    this.isAsking = false;
    if (run === this.run) {
      this.choices = choices;
      if (asked === this.asked) this.missing = missing;
      else this.asked_us = -1;
      this.tell();
      if (this.asked_us !== this.t_us) setTimeout(() => void this.ask(), this.isPlaying ? 120 : 0);
    }
  }

  // The page.

  setLanguage(language: string): void {
    localStorage.setItem("esm.language", language);
    document.documentElement.lang = language;
    this.set({ language });
  }

  toggleTheme(): void {
    this.theme = this.shownTheme() === "dark" ? "light" : "dark";
    localStorage.setItem("esm.theme", this.theme);
    this.applyTheme();
    this.tell();
  }

  /** The theme that was chosen, or else the one of the system. */
  private shownTheme(): string {
    return this.theme || (DARK.matches ? "dark" : "light");
  }

  private applyTheme(): void {
    document.documentElement.dataset.theme = this.shownTheme();
  }

  endTour(): void {
    localStorage.setItem("esm.toured", "yes");
    this.set({ tour: -1 });
  }
}

function keyOf(breakpoint: Breakpoint): string {
  return JSON.stringify(Object.values(breakpoint));
}

function termOf({ from, to, number, term }: TermOf): TermOf {
  return { from, to, number, term };
}

/** What a breakpoint waits for, as people read it. */
export function breakWords(it: Breakpoint, words: Studio["words"]): string {
  const name = (path: string) => path.slice(path.lastIndexOf("/") + 1);
  switch (it.kind) {
    case "state": return words.breakState(it.path);
    case "transition": return words.breakTransition(name(it.from), name(it.to));
    case "term": return words.breakTerm(it.term, name(it.from), name(it.to));
    case "value": return `${it.curve} ${it.above ? ">" : "<"} ${it.limit}`;
  }
}

/** A time as people read it. */
export function seconds(t_us: number): string {
  return `${(t_us / 1e6).toFixed(2)} s`;
}
