import { useEffect, useRef } from "preact/hooks";
import { seconds, SPEEDS, type Studio } from "./studio";

const ROW_PX = 20;
const NAMES_PX = 128;
/** Colours of states, in turn: light enough for dark words, apart for colour-blind people, too. */
const FILLS = ["#9ecae9", "#ffbf79", "#88d27a", "#f2cf5b", "#d6a5c9", "#9fd4cf", "#ff9d98", "#c9c3bd"];

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

/** The time: states over it, and all that moves through it. */
export function Time({ studio }: { studio: Studio }) {
  const words = studio.words;
  const canvas = useRef<HTMLCanvasElement>(null);
  const run = studio.run;
  const kept = useRef<{ of: unknown; length: number; done: number; rows: Map<string, Bar[]> } | undefined>(undefined);
  if (kept.current?.of !== run || kept.current?.length !== run?.active.length || kept.current?.done !== run?.done_us) {
    kept.current = { of: run, length: run?.active.length ?? 0, done: run?.done_us ?? 0, rows: rows(studio) };
  }
  const bars = kept.current!.rows;
  useEffect(() => {
    const paint = () => draw(canvas.current, studio, bars);
    paint();
    const observer = new ResizeObserver(paint);
    if (canvas.current) observer.observe(canvas.current);
    return () => observer.disconnect();
  });
  const whole_us = run?.plan.until_us ?? studio.until_us;
  const seek = (event: PointerEvent) => {
    if (!canvas.current || !run || !(event.buttons & 1)) return;
    const box = canvas.current.getBoundingClientRect();
    studio.isPlaying = false;
    studio.seek(((event.clientX - box.left - NAMES_PX) / (box.width - NAMES_PX - 8)) * whole_us);
  };
  const isWorking = run !== null && !run.end && !run.error;
  return (
    <section class="panel time" aria-label={words.time}>
      <div class="transport">
        <button class="main" onClick={() => studio.start()} title="Ctrl+Enter" disabled={!studio.isLoaded}>
          ▶ {run ? words.runAgain : words.run}</button>
        <span class="group">
          <button disabled={!run} onClick={() => { studio.isPlaying = false; studio.seek(0); }}
            aria-label={words.toStart} title={words.toStart}><Icon of="start" /></button>
          <button disabled={!run} onClick={() => studio.step(-1)} aria-label={words.stepBack} title={`${words.stepBack} (Alt+←)`}><Icon of="back" /></button>
          <button disabled={!run} onClick={() => studio.toggle()}
            aria-label={studio.isPlaying ? words.pause : words.play}
            title={`${studio.isPlaying ? words.pause : words.play} (Alt+Enter)`}><Icon of={studio.isPlaying ? "pause" : "play"} /></button>
          <button disabled={!run} onClick={() => studio.step(1)} aria-label={words.step} title={`${words.step} (Alt+→)`}><Icon of="step" /></button>
        </span>
        <output class="clock" aria-label={words.time}>{seconds(studio.t_us)} / {(whole_us / 1e6).toFixed(0)} s</output>
        <input type="range" class="slider" min={0} max={whole_us} step={10_000} value={studio.t_us} disabled={!run}
          aria-label={words.time} aria-valuetext={seconds(studio.t_us)}
          onInput={(event) => { studio.isPlaying = false; studio.seek(Number(event.currentTarget.value)); }} />
        <label class="speed"><span>{words.speed}</span> <select value={studio.speed}
          onChange={(event) => studio.set({ speed: Number(event.currentTarget.value) })}>
          {SPEEDS.map((speed) => <option value={speed}>×{speed}</option>)}</select></label>
        <button onClick={() => studio.longer()} title={words.longerHelp}>{words.longer}</button>
        {studio.isOutdated && <span class="outdated"><span>{words.outdated}</span>
          <button onClick={() => studio.change()} title={words.changeHelp} disabled={studio.problems.some((it) => it.severity === 1)}>
            {words.change}</button></span>}
      </div>
      <p class="note" role="status">
        {run?.error ? <strong class="error">{words.failed} {run.error}</strong> : isWorking && studio.t_us >= run!.done_us ? words.running : studio.notice}
      </p>
      {run && <div class="lanes" tabIndex={0} role="region" aria-label={words.timelineLabel}>
        <canvas ref={canvas} style={{ height: `${bars.size * ROW_PX + 22}px` }} role="img" aria-label={words.timelineLabel}
          onPointerDown={(event) => { event.currentTarget.setPointerCapture(event.pointerId); seek(event); }} onPointerMove={seek} />
      </div>}
    </section>
  );
}

function draw(canvas: HTMLCanvasElement | null, studio: Studio, bars: Map<string, Bar[]>): void {
  const pen = canvas?.getContext("2d");
  if (!canvas || !pen || !studio.run) return;
  const ratio = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  const style = getComputedStyle(document.documentElement);
  const ink = style.getPropertyValue("--ink").trim();
  const soft = style.getPropertyValue("--soft").trim();
  const whole = studio.run.plan.until_us;
  const x = (t_us: number) => NAMES_PX + ((width - NAMES_PX - 8) * t_us) / whole;
  pen.font = "12px system-ui, sans-serif";
  pen.textBaseline = "middle";
  let row = 0;
  for (const [region, list] of bars) {
    const top = row++ * ROW_PX;
    pen.fillStyle = ink;
    pen.textAlign = "right";
    const name = region.split("/").slice(-2).join("/");
    pen.save();
    pen.beginPath();
    pen.rect(0, top, NAMES_PX - 6, ROW_PX);
    pen.clip();
    pen.fillText(region.includes("/") ? name : region, NAMES_PX - 8, top + ROW_PX / 2);
    pen.restore();
    const names: string[] = [];
    for (const bar of list) {
      if (!names.includes(bar.state)) names.push(bar.state);
      const [from, to] = [x(bar.from), x(bar.to)];
      if (bar.state === "initial" || bar.state === "final") pen.fillStyle = soft;
      else pen.fillStyle = FILLS[names.indexOf(bar.state) % FILLS.length];
      pen.fillRect(from, top + 2, Math.max(1, to - from), ROW_PX - 4);
      if (to - from > 34) {
        pen.save();
        pen.beginPath();
        pen.rect(from, top, to - from - 3, ROW_PX);
        pen.clip();
        pen.fillStyle = "#1a1a1a";
        pen.textAlign = "left";
        pen.fillText(bar.state, from + 4, top + ROW_PX / 2);
        pen.restore();
      }
    }
  }
  const foot = row * ROW_PX;
  pen.fillStyle = ink;
  pen.textAlign = "center";
  const each = [1, 2, 5, 10, 20, 60, 120, 300, 600].find((step) => whole / 1e6 / step <= 13) ?? 600;
  for (let second = 0; second <= whole / 1e6; second += each) {
    pen.fillRect(x(second * 1e6), foot, 1, 4);
    pen.fillText(`${second} s`, Math.min(x(second * 1e6), width - 18), foot + 12);
  }
  const here = x(studio.t_us);
  pen.fillStyle = style.getPropertyValue("--accent").trim();
  pen.fillRect(here - 1, 0, 2, height);
}
