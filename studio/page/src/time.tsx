import { useEffect, useRef, useState } from "preact/hooks";
import { FILLS, ink, penOf } from "./colours";
import { CURVE_PX, drawCurve, drawName, drawSlots, NAMES_PX, SLOT_PX, slotWords } from "./plots";
import { breakWords, seconds, SPEEDS, type Studio } from "./studio";

const ROW_PX = 20;
/** Height of the axis. */
const FOOT_PX = 22;
/** Transitions, log lines and others that are listed at most, around the moment. */
const MOST_EVENTS = 200;

interface Bar {
  state: string;
  from: number;
  to: number;
}

/** The stretches of each region, by its path. */
function rows(studio: Studio): Map<string, Bar[]> {
  const run = studio.run;
  const all = new Map<string, Bar[]>();
  if (!run) return all;
  const open = new Map<string, Bar>();
  for (const [t_us, active] of run.active) {
    const now = new Map(active.map((path) => [path.slice(0, path.lastIndexOf("/")), path]));
    for (const [region, bar] of open) {
      if (now.get(region)?.endsWith("/" + bar.state)) continue;
      bar.to = t_us;
      open.delete(region);
    }
    for (const [region, path] of now) {
      if (open.has(region)) continue;
      const bar = { state: path.slice(region.length + 1), from: t_us, to: run.done_us };
      open.set(region, bar);
      const bars = all.get(region) ?? [];
      bars.push(bar);
      all.set(region, bars);
    }
  }
  for (const bar of open.values()) bar.to = run.done_us;
  return all;
}

const ICONS = {
  start: "M3 2v12h2V2zM14 2 6 8l8 6z",
  back: "M4 2v12h2V2zM13 3 7 8l6 5z",
  play: "M4 2v12l10-6z",
  pause: "M4 2h3v12H4zM9 2h3v12H9z",
  step: "M3 3l6 5-6 5zM10 2v12h2V2z",
};

function Icon({ of }: { of: keyof typeof ICONS }) {
  return <svg class="icon" viewBox="0 0 16 16" aria-hidden="true"><path d={ICONS[of]} /></svg>;
}

/** Which numbers are plotted, and beyond which values the run pauses. */
function Curves({ studio }: { studio: Studio }) {
  const words = studio.words;
  const [search, setSearch] = useState("");
  const [limit, setLimit] = useState("");
  const [curve, setCurve] = useState("");
  const found = studio.curves.filter(([name]) => name.toLowerCase().includes(search.toLowerCase()));
  const chosen = curve || studio.plotted[0] || "";
  const pauses = (above: boolean) => {
    const value = Number.parseFloat(limit.replace(",", "."));
    if (chosen && Number.isFinite(value)) studio.toggleBreakpoint({ kind: "value", curve: chosen, above, limit: value });
  };
  return (
    <div class="curves">
      <input type="search" value={search} placeholder={words.searchValue} aria-label={words.searchValue}
        onInput={(event) => setSearch(event.currentTarget.value)} />
      <ul tabIndex={0} aria-label={words.values}>{found.map(([name, unit]) => (
        <li><label><input type="checkbox" checked={studio.plotted.includes(name)} onChange={() => studio.plot(name)} />
          {" "}{name}{unit && ` (${unit})`}</label></li>
      ))}</ul>
      <div class="limit">
        <label>{words.pauseWhere} <select value={chosen} onChange={(event) => setCurve(event.currentTarget.value)}>
          {studio.plotted.map((name) => <option value={name} selected={name === chosen}>{name}</option>)}</select></label>
        <input type="text" inputMode="decimal" value={limit} aria-label={words.limit} placeholder={words.limit}
          onInput={(event) => setLimit(event.currentTarget.value)} />
        <button disabled={!chosen || !limit} onClick={() => pauses(true)}>{words.above}</button>
        <button disabled={!chosen || !limit} onClick={() => pauses(false)}>{words.below}</button>
      </div>
    </div>
  );
}

/** What happened, in the order of time; a click leads to its moment. */
function Events({ studio }: { studio: Studio }) {
  const words = studio.words;
  const run = studio.run;
  if (!run) return null;
  const all: [number, string, string][] = [
    ...run.transitions.map(([t_us, from, to, event, sent]): [number, string, string] => (
      [t_us, "transition", `${from} → ${to}${event === "pulse" ? "" : ` (${event})`}${sent.length > 0 ? ` ⇒ ${sent.join(", ")}` : ""}`])),
    ...run.log.map(([t_us, text]): [number, string, string] => [t_us, "log", text.trim()]),
    ...run.words.filter(([, text]) => !text.includes(" -> ")).map(([t_us, text]): [number, string, string] => [t_us, "word", text.trim()]),
    ...run.faults.map(([t_us, code]): [number, string, string] => [t_us, "fault", code]),
    ...(run.connected?.notes ?? []).map((text): [number, string, string] => [run.done_us, "word", text]),
  ];
  all.sort((a, b) => a[0] - b[0]);
  const here = all.filter(([t_us]) => t_us <= studio.t_us).length;
  const first = Math.max(0, here - MOST_EVENTS);
  return (
    <ol class="events" tabIndex={0} aria-label={words.events}>{all.slice(first, here).reverse().map(([t_us, kind, text]) => (
      <li class={kind}><button class="plain" onClick={() => { studio.isPlaying = false; studio.seek(t_us); }}>
        <span class="facts">{seconds(t_us)}</span> {text}</button></li>
    ))}</ol>
  );
}

/** The time: states over it, and all that moves through it. */
export function Time({ studio }: { studio: Studio }) {
  const words = studio.words;
  const canvas = useRef<HTMLCanvasElement>(null);
  const slotCanvas = useRef<HTMLCanvasElement>(null);
  const run = studio.run;
  const kept = useRef<{ of: unknown; length: number; done: number; rows: Map<string, Bar[]> } | undefined>(undefined);
  if (kept.current?.of !== run || kept.current?.length !== run?.active.length || kept.current?.done !== run?.done_us) {
    kept.current = { of: run, length: run?.active.length ?? 0, done: run?.done_us ?? 0, rows: rows(studio) };
  }
  const bars = kept.current!.rows;
  useEffect(() => {
    const paint = () => {
      draw(canvas.current, studio, bars);
      drawTiming(slotCanvas.current, studio);
    };
    paint();
    const observer = new ResizeObserver(paint);
    if (canvas.current) observer.observe(canvas.current);
    return () => observer.disconnect();
  });
  const [choosesCurves, setChoosesCurves] = useState(false);
  const start_us = run?.start_us ?? 0;
  const whole_us = run?.until_us ?? studio.until_us;
  const seek = (event: PointerEvent) => {
    if (!canvas.current || !run || !(event.buttons & 1)) return;
    const box = canvas.current.getBoundingClientRect();
    studio.isPlaying = false;
    const part = (event.clientX - box.left - NAMES_PX) / (box.width - NAMES_PX - 8);
    studio.seek(start_us + part * (whole_us - start_us));
  };
  const isWorking = run?.kind === "simulated" && !run.end && !run.error;
  const isLive = run?.kind === "live";
  // There is no moment to go to before the recording has been read.
  const isReading = run?.kind === "recorded" && !run.isWhole && !run.error;
  const hasMoments = run !== null && !isReading;
  const goesOn = isLive ? studio.follows : studio.isPlaying;
  const kinds = { simulated: "", recorded: isReading ? words.reading : words.recorded, live: run?.connected ? words.connected(run.connected.board, run.behind_ms) : words.connecting };
  const height = bars.size * ROW_PX + studio.plotted.length * CURVE_PX + FOOT_PX;
  const slots = studio.slots?.slots.length ?? 0;
  return (
    <section class="panel time" aria-label={words.time} data-behind-ms={run?.behind_ms}>
      <div class="transport">
        <button class="main" onClick={() => studio.start()} title="Ctrl+Enter" disabled={!studio.isLoaded}>
          ▶ {run?.kind === "simulated" ? words.runAgain : words.run}</button>
        {studio.isLive && !isLive && <button onClick={() => studio.connect()}>{words.connect}</button>}
        <span class="group">
          <button disabled={!hasMoments} onClick={() => { studio.isPlaying = false; studio.seek(start_us); }}
            aria-label={words.toStart} title={words.toStart}><Icon of="start" /></button>
          <button disabled={!hasMoments} onClick={() => studio.step(-1)} aria-label={words.stepBack} title={`${words.stepBack} (Alt+←)`}><Icon of="back" /></button>
          <button disabled={!hasMoments} onClick={() => studio.toggle()}
            aria-label={goesOn ? words.pause : words.play}
            title={`${goesOn ? words.pause : words.play} (Alt+Enter)`}><Icon of={goesOn ? "pause" : "play"} /></button>
          <button disabled={!hasMoments} onClick={() => studio.step(1)} aria-label={words.step} title={`${words.step} (Alt+→)`}><Icon of="step" /></button>
        </span>
        <output class="clock" aria-label={words.time}>{seconds(studio.t_us)} / {(whole_us / 1e6).toFixed(0)} s</output>
        <input type="range" class="slider" min={start_us} max={whole_us} step={10_000} value={studio.t_us} disabled={!hasMoments}
          aria-label={words.time} aria-valuetext={seconds(studio.t_us)}
          onInput={(event) => { studio.isPlaying = false; studio.seek(Number(event.currentTarget.value)); }} />
        <label class="speed"><span>{words.speed}</span> <select value={studio.speed}
          onChange={(event) => studio.set({ speed: Number(event.currentTarget.value) })}>
          {SPEEDS.map((speed) => <option value={speed} selected={speed === studio.speed}>×{speed}</option>)}</select></label>
        {(!run || run.kind === "simulated") && <button onClick={() => studio.longer()} title={words.longerHelp}>{words.longer}</button>}
        <span class="group">
          <button disabled={!run} aria-pressed={choosesCurves} onClick={() => setChoosesCurves(!choosesCurves)}>{words.values}</button>
          <button disabled={!run} aria-pressed={studio.showsSlots} onClick={() => studio.showSlots()}>{words.slots}</button>
          <button disabled={!run} aria-pressed={studio.showsEvents}
            onClick={() => studio.set({ showsEvents: !studio.showsEvents })}>{words.events}</button>
        </span>
        {studio.isOutdated && <span class="outdated"><span>{words.outdated}</span>
          <button onClick={() => studio.change()} title={words.changeHelp} disabled={studio.problems.some((it) => it.severity === 1)}>
            {words.change}</button></span>}
      </div>
      <p class="note" role="status">
        {run?.error ? <strong class="error">{run.kind === "simulated" ? words.failed : ""} {run.error}</strong>
          : isWorking && studio.t_us >= run!.done_us ? words.running : studio.notice || run?.note || (run && kinds[run.kind])}
      </p>
      {studio.breakpoints.size > 0 && <ul class="breaks" aria-label={words.breakpoints}>
        {[...studio.breakpoints.values()].map((it) => (
          <li><button title={words.takeBack} onClick={() => studio.toggleBreakpoint(it)}>● {breakWords(it, words)} ×</button></li>
        ))}</ul>}
      {choosesCurves && run && <Curves studio={studio} />}
      {run && <div class="lanes" tabIndex={0} role="region" aria-label={words.timelineLabel}>
        <canvas ref={canvas} style={{ height: `${height}px` }} role="img" aria-label={words.timelineLabel}
          onPointerDown={(event) => { event.currentTarget.setPointerCapture(event.pointerId); seek(event); }} onPointerMove={seek} />
      </div>}
      {run && studio.showsSlots && <div class="lanes" tabIndex={0} role="region" aria-label={words.slotsHelp}>
        <canvas ref={slotCanvas} style={{ height: `${slots * SLOT_PX + FOOT_PX}px` }} role="img"
          aria-label={`${words.slotsHelp} ${slotWords(studio)}`} />
        <p class="note">{run.kind === "live" ? words.slotsLive : words.slotsNominal}</p>
      </div>}
      {studio.showsEvents && <Events studio={studio} />}
    </section>
  );
}

function drawTiming(canvas: HTMLCanvasElement | null, studio: Studio): void {
  const drawn = penOf(canvas);
  if (!drawn) return;
  drawn.pen.textBaseline = "middle";
  drawSlots({ ...drawn, top: 0 }, studio);
}

function draw(canvas: HTMLCanvasElement | null, studio: Studio, bars: Map<string, Bar[]>): void {
  const drawn = penOf(canvas);
  const run = studio.run;
  if (!drawn || !run) return;
  const { pen, width, height } = drawn;
  const [start, whole] = [run.start_us, run.until_us];
  const x = (t_us: number) => NAMES_PX + ((width - NAMES_PX - 8) * (t_us - start)) / (whole - start);
  const soft = ink("--soft");
  pen.font = "12px system-ui, sans-serif";
  pen.textBaseline = "middle";
  let row = 0;
  for (const [region, list] of bars) {
    const top = row++ * ROW_PX;
    const name = region.split("/").slice(-2).join("/");
    drawName({ pen, width, top }, region.includes("/") ? name : region, ROW_PX);
    const names: string[] = [];
    // Of stretches that are too short to be seen, one a column is drawn.
    let drawn_to = -1;
    for (const bar of list) {
      if (!names.includes(bar.state)) names.push(bar.state);
      const [from, to] = [x(bar.from), x(bar.to)];
      if (to < drawn_to + 1 && to - from < 1) continue;
      drawn_to = to;
      if (bar.state === "initial" || bar.state === "final") pen.fillStyle = soft;
      else pen.fillStyle = FILLS[names.indexOf(bar.state) % FILLS.length];
      pen.fillRect(from, top + 2, Math.max(1, to - from), ROW_PX - 4);
      if (to - from > 34) {
        pen.save();
        pen.beginPath();
        pen.rect(from, top, to - from - 3, ROW_PX);
        pen.clip();
        pen.fillStyle = bar.state === "initial" || bar.state === "final" ? ink("--paper") : "#1a1a1a";
        pen.textAlign = "left";
        pen.fillText(bar.state, from + 4, top + ROW_PX / 2);
        pen.restore();
      }
    }
  }
  let foot = row * ROW_PX;
  for (const [index, name] of studio.plotted.entries()) {
    drawCurve({ pen, width, top: foot }, studio, name, index, x);
    foot += CURVE_PX;
  }
  pen.font = "12px system-ui, sans-serif";
  pen.fillStyle = ink("--ink");
  pen.textAlign = "center";
  const seconds_in_all = (whole - start) / 1e6;
  const each = [1, 2, 5, 10, 20, 60, 120, 300, 600, 3600].find((step) => seconds_in_all / step <= 13) ?? 3600;
  for (let second = Math.ceil(start / 1e6 / each) * each; second <= whole / 1e6; second += each) {
    pen.fillRect(x(second * 1e6), foot, 1, 4);
    pen.fillText(`${second} s`, Math.min(x(second * 1e6), width - 18), foot + 12);
  }
  const here = x(studio.t_us);
  pen.fillStyle = ink("--accent");
  pen.fillRect(here - 1, 0, 2, height);
}
