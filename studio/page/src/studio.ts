/** What the page knows, and what can be done in it. */
import { Editor, type Problem } from "./editor";
import { Engine, Refused } from "./engine";
import type { Choices, Drawn, Shown, World } from "./protocol";
import { behind, type Plan, Run } from "./run";
import { pack, unpack } from "./share";
import { languages, wanted } from "./words";

interface Catalogue {
  /** Missions and worlds by their paths below the root. */
  files: Record<string, string>;
  /** The file to open at first. */
  open?: string;
}

const KEPT = "esm.files";
const FIRST = "/missions/patrol.esm";
const FIRST_WORLD = "/missions/worlds/office.world";
const DEFAULT_UNTIL_US = 60_000_000;
const LONGEST_US = 3_600_000_000;
const DARK = matchMedia("(prefers-color-scheme: dark)");
export const SPEEDS = [0.25, 1, 4, 16];

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
  folds = true;
  cursor = 0;
  run: Run | null = null;
  until_us = DEFAULT_UNTIL_US;
  t_us = 0;
  isPlaying = false;
  speed = 1;
  breakpoints = new Set<string>();
  choices: Choices | null = null;
  notice = "";
  message = "";
  tour = -1;
  isLoaded = false;
  /** Whether the next click in the world puts a person there. */
  placesPerson = false;
  /** The part that a narrow screen shows. */
  tab: "text" | "diagram" | "robot" | "why" = "text";
  theme = localStorage.getItem("esm.theme") ?? "";
  editor!: Editor;
  private desk: Engine;
  private interventions: { breaks: Plan["breaks"]; stop_at_us: number | null; people: string[] } = {
    breaks: [], stop_at_us: null, people: [],
  };
  private then: { at_us: number; path: string; warm: boolean; text: string }[] = [];
  private planText = "";
  private listeners = new Set<() => void>();
  private lastFrame = 0;
  private isDrawing = false;
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
    return [this.text(this.worldPath), ...this.interventions.people].join("\n");
  }

  async begin(place: HTMLElement): Promise<void> {
    try {
      this.own = JSON.parse(localStorage.getItem(KEPT) ?? "{}");
    } catch {
      this.own = {};
    }
    const answer = await fetch("files.json");
    const catalogue = (await answer.json()) as Catalogue;
    this.shipped = catalogue.files;
    this.given = Object.keys(catalogue.files).filter((path) => !path.startsWith("/missions/"));
    if (catalogue.open) this.path = catalogue.open;
    const shared = await unpack(location.hash);
    if (shared) {
      this.path = shared.path;
      if (shared.text !== this.shipped[shared.path]) this.own[shared.path] = shared.text;
      if (this.shipped[shared.world] || this.own[shared.world]) this.worldPath = shared.world;
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
    if (!localStorage.getItem("esm.toured")) this.set({ tour: 0 });
  }

  private async giveFiles(): Promise<void> {
    await this.desk.call({ call: "files", files: this.files() });
  }

  async openFile(path: string): Promise<void> {
    this.path = path;
    localStorage.setItem("esm.path", path);
    this.drawn = null;
    this.problems = [];
    this.editor.open(path, this.text(path), this.words.editorLabel);
    this.forget();
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
    input.accept = ".esm,.world";
    input.multiple = true;
    input.onchange = async () => {
      let last = "";
      for (const file of input.files ?? []) {
        const path = "/yours/" + file.name;
        this.own[path] = await file.text();
        if (path.endsWith(".world")) this.worldPath = path;
        else last = path;
      }
      this.keepFiles();
      await this.giveFiles();
      if (last) await this.openFile(last);
      await this.showWorld();
    };
    input.click();
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
    const hash = await pack({ path: this.path, text: this.text(this.path), world: this.worldPath });
    history.replaceState(null, "", hash);
    try {
      await navigator.clipboard.writeText(location.href);
      this.set({ message: this.words.shared });
    } catch {
      this.set({ message: this.words.notShared });
    }
  }

  // The diagram.

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
        const depth = this.folds ? null : 0;
        const drawn = await this.desk.call<Drawn>({ call: "draw", path, depth, data: this.showsData });
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
    return this.run !== null && last !== this.text(this.path);
  }

  /** Lets go of the run. */
  private forget(): void {
    this.run?.close();
    this.run = null;
    this.t_us = 0;
    this.isPlaying = false;
    this.choices = null;
    this.then = [];
    this.notice = "";
    this.interventions = { breaks: [], stop_at_us: null, people: [] };
  }

  /** Begins a run of the text as it is. */
  start(): void {
    this.then = [];
    this.planText = this.text(this.path);
    this.t_us = 0;
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
    const { breaks, stop_at_us } = this.interventions;
    this.run = new Run({
      path: this.path, files, world: this.worldText(), seed: 1, until_us: this.until_us, breaks, stop_at_us, then,
    }, () => this.runTold());
    this.choices = null;
    this.asked_us = -1;
    this.isPlaying = plays;
    if (plays) this.animate();
    this.tell();
  }

  private runTold(): void {
    const run = this.run;
    if (run?.world) this.world = run.world;
    if (run?.end && this.then.length > 0 && run.carried.length > this.then.length) {
      const last = this.then[this.then.length - 1];
      this.notice = this.words.changed(run.carried[run.carried.length - 1], seconds(last.at_us));
    }
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

  putPerson(x: number, y: number): void {
    const from = `${Math.round(this.t_us / 1000)} ms`;
    this.interventions.people.push(`person ${x.toFixed(2)},${y.toFixed(2)} 0.25 from ${from}`);
    this.placesPerson = false;
    this.plan(this.isPlaying);
  }

  putPersonAhead(): void {
    const at = this.robot();
    if (at) this.putPerson(at[1] + 0.8 * Math.cos(at[3]), at[2] + 0.8 * Math.sin(at[3]));
  }

  clearInterventions(): void {
    this.interventions = { breaks: [], stop_at_us: null, people: [] };
    this.plan(this.isPlaying);
  }

  interventionWords(): string[] {
    const { breaks, stop_at_us, people } = this.interventions;
    return [
      ...breaks.map((it) => `${this.words.sonar(it.sonar)} · ${seconds(it.at_us)}`),
      ...(stop_at_us === null ? [] : [`${this.words.stop} · ${seconds(stop_at_us)}`]),
      ...people.map((line) => line.replace(/ from (\d+) ms/, (_, ms) => ` · ${seconds(ms * 1000)}`)),
    ];
  }

  robot(): Shown | null {
    return this.run?.at(this.t_us) ?? null;
  }

  // Time.

  get isOver(): boolean {
    return this.run !== null && this.run.end !== null && this.t_us >= this.run.done_us;
  }

  play(): void {
    if (!this.run) return this.start();
    if (this.isOver) this.t_us = 0;
    this.isPlaying = true;
    this.animate();
    this.tell();
  }

  pause(): void {
    this.isPlaying = false;
    void this.ask();
    this.tell();
  }

  toggle(): void {
    if (this.isPlaying) this.pause();
    else this.play();
  }

  seek(t_us: number): void {
    this.t_us = Math.max(0, Math.min(t_us, this.run?.done_us ?? 0));
    void this.ask();
    this.tell();
  }

  /** One macro step. They have the distance of the interpreter's slot; the engine knows which is next. */
  step(by: 1 | -1): void {
    this.isPlaying = false;
    const period_us = this.period_us();
    const at = Math.floor(this.t_us / period_us) * period_us;
    this.seek(by > 0 ? at + period_us : this.t_us > at ? at : at - period_us);
  }

  /** Distance of macro steps, in microseconds: the trace's first two. */
  private period_us(): number {
    const trace = this.run?.end?.trace ?? "";
    const times = [...trace.slice(0, 20_000).matchAll(/"kind":"step","step":\d+,"t_us":(\d+)/g)];
    return times.length > 1 ? Number(times[1][1]) - Number(times[0][1]) || 10_000 : 10_000;
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
    const entered = this.breakBetween(before, to);
    if (entered) {
      to = entered.t_us;
      this.isPlaying = false;
      this.notice = this.words.breakHere(entered.state);
    }
    this.t_us = to;
    if ((run.end || run.error) && to >= run.done_us) this.isPlaying = false;
    void this.ask();
    this.tell();
    if (this.isPlaying) this.frame = requestAnimationFrame((next) => this.tick(next));
  }

  /** The first state with a breakpoint that is entered behind `from` and up to `to`. */
  private breakBetween(from: number, to: number): { t_us: number; state: string } | null {
    const active = this.run?.active ?? [];
    if (this.breakpoints.size === 0) return null;
    for (let index = behind(active, from, (it) => it[0]); index < active.length && active[index][0] <= to; index++) {
      const before = new Set(active[index - 1]?.[1] ?? []);
      const state = active[index][1].find((path) => this.breakpoints.has(path) && !before.has(path));
      if (state) return { t_us: active[index][0], state };
    }
    return null;
  }

  toggleBreakpoint(path: string): void {
    if (!this.breakpoints.delete(path)) this.breakpoints.add(path);
    this.tell();
  }

  /** Asks for the choices of this moment, one question at a time. */
  private async ask(): Promise<void> {
    const run = this.run;
    if (!run?.end || this.isAsking || this.asked_us === this.t_us) return;
    this.isAsking = true;
    this.asked_us = this.t_us;
    const choices = await run.choices(this.asked_us);
    this.isAsking = false;
    if (run === this.run) {
      this.choices = choices;
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

/** A time as people read it. */
export function seconds(t_us: number): string {
  return `${(t_us / 1e6).toFixed(2)} s`;
}
